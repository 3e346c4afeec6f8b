"""Models that a control engineer would try first."""
