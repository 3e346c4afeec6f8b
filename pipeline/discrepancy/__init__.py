"""What measured logs say about a model: residuals, the search for effects, the gate, baselines, verdicts."""
