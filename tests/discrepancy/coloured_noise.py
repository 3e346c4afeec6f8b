"""Noise like what models leave: with a correlation over some ten rows."""

import numpy as np

N = 2000


def coloured(random: np.random.Generator) -> np.ndarray:
    """(N,) of unit variance."""
    return np.convolve(random.standard_normal(N + 20), np.ones(10) / np.sqrt(10.0), "same")[:N]
