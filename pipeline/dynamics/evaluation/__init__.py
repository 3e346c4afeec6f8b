"""Prediction errors and behaviour of any predictor on any logs."""
