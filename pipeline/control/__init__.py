"""Controllers of the reaching task: training, storage and evaluation."""
