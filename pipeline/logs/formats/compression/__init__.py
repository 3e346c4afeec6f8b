"""Compressed bags: whole files, chunks, single messages."""
