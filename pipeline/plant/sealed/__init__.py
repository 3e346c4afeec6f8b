"""Effects that are drawn by seed and kept sealed, and the judgement of a verdict."""
