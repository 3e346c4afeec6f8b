"""Typed configuration and the frame that every stage runs in."""
