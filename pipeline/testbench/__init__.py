"""The simulated machine at work: recorded into bags, and in the machine's place in the graph."""
