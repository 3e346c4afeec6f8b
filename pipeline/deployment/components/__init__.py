"""The components of the graph, independent of clocks and transports."""
