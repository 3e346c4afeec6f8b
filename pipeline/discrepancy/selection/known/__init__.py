"""Effects that a given model has already: the start of the search, and a prior of their values."""
