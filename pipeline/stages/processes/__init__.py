"""Processes that a stage starts: with which overrides, and each in a graph of its own."""
