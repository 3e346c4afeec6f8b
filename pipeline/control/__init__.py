"""Controllers of the reaching task: how they are learned, stored and evaluated."""
