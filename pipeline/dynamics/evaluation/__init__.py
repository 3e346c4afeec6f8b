"""Errors of any predictor on any logs."""
