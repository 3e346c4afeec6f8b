"""What else could be done with the measured rows: fine-tuning, a residual network, a wrong effect."""
