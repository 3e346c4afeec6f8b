"""The paper's tables with our results."""
