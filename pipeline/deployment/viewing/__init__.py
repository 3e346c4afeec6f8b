"""A trial for viewers: what a log holds as the topics that Foxglove and Rerun draw."""
