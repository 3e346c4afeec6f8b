"""Effects drawn by seed and kept sealed, and the judgement of a verdict."""
