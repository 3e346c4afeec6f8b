"""The search for effects on rows for fitting and selection."""
