"""Kinds of models identified from logs of machines that none was tuned on: error over minutes, floor, coverage."""
