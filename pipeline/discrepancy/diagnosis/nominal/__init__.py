"""What is learned of nominal logs: the floor, what gains there without an effect, and the file that keeps it."""
