"""Recorded sessions of the simulated machine, driven by a scripted operator."""
