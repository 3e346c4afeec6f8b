"""Hyper-parameter studies that any number of workers share and that survive the death of any of them."""
