"""Logs and running graphs as topics that Foxglove and Rerun draw."""
