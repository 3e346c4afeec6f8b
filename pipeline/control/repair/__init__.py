"""A deployed policy that is trained further on a model with effects, and compared with what it was."""
