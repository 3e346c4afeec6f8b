"""Figures of the watch."""
