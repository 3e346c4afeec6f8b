"""Training by back-propagation through time."""
