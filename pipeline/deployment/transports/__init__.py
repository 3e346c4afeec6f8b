"""Transports of the components' messages: simulated time, ROS 1, MCAP files."""
