"""Logs: from bags and tables of any format to checked tuples (contract, sections 1 and 2)."""
