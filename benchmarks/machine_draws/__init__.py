"""Simulated machines of the E10's class, each with constants of its own, drawn by seed; no machine is in a list."""
