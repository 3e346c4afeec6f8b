"""Find logs: which files are one log, of which format, under which name."""
