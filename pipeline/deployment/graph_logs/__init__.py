"""Logs of the graph: its topics in a bag, and what they tell of reaching, delays and safety."""
