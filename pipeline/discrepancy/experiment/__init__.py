"""The next experiment: what to record so that the explanations which remain can be told apart."""
