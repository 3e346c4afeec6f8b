"""Readers of the stages' outputs in the artifacts folder."""
