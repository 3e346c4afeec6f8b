"""Readers of every file format, intact or damaged, which yield blocks of undecoded messages."""
