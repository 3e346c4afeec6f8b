"""Figures, from plain arrays to SVG or film."""
