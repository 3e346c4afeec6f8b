"""Drivers between the graph's messages and a machine."""
