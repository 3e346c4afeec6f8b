"""The physics of the simulated machine."""
