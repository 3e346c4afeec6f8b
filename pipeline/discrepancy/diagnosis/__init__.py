"""Rows, the diagnosis model, and what it is off by on nominal logs."""
