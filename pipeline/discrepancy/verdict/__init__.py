"""From what was accepted to closed_loop.json and the report's data."""
