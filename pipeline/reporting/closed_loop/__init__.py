"""The report of one run of close_loop."""
