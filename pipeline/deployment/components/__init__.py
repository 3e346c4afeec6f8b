"""The components of the graph; none of them knows a clock or a transport."""
