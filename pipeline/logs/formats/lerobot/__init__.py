"""LeRobot datasets, version 3, read as logs, one per episode."""
