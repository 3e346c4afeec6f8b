"""The nonlinear finite-impulse-response (NFIR) model."""
