"""Hyper-parameter studies that several workers share and that survive the death of any worker."""
