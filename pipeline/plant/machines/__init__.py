"""Which machines are simulated, with the values of their parameters."""
