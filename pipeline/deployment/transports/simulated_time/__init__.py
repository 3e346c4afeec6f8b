"""The graph in simulated time: an event queue with measured delays, deterministic by seed."""
