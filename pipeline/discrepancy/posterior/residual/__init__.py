"""The model of a joint's residual: columns of effects, noise, and what varies without a cause."""
