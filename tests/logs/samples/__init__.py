"""Logs of every kind to read, written here or by ROS itself."""
