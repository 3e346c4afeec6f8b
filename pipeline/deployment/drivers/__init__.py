"""Between the graph's messages and a machine."""
