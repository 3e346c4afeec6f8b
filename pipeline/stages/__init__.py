"""Thin entry points: read the configuration, call the library, write artifacts, log the run."""
