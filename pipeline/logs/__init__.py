"""Logs: bags and tables of any format in, tuples that can be trusted out (contract, sections 1 and 2)."""
