"""From undecoded messages to columns of numbers."""
