"""MCAP files (mcap.dev/spec)."""
