"""Whether an effect is as large in every log as it was fitted over all of them: else it is another, or chance."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

FEWEST_BLOCKS = 4.0  # in which a log shows the effect: of fewer, nobody knows the scatter
DEVIATIONS = 2.0


class Size(NamedTuple):
    """Of an effect in one log, in units of the fitted one, and its standard deviation."""

    value: float
    deviation: float


def sizes_by_log(change: np.ndarray, without: np.ndarray, log: np.ndarray, block: np.ndarray) -> list[Size]:
    """One per log that shows the effect in blocks enough: least squares of what is there on what the effect does.

    Deviations are robust against any correlation within blocks, as `refine.parameter_covariance`.

    Args:
        change: (N,) of the velocity by the effect.
        without: (N,) residual without the effect.
        log: (N,) index of the row's log.
        block: (N,) index of its block; none is of two logs.
    """
    sizes = []
    for index in np.unique(log):
        rows = log == index
        c, r = change[rows], without[rows]
        _, place = np.unique(block[rows], return_inverse=True)
        squares = np.bincount(place, c**2)
        total = squares.sum()
        if total <= 0.0:
            continue
        n_blocks = total**2 / np.sum(squares**2)
        if n_blocks < FEWEST_BLOCKS:
            continue
        size = float(c @ r / total)
        scores = np.bincount(place, c * (r - size * c))
        deviation = np.sqrt(np.sum(scores**2) * n_blocks / (n_blocks - 1.0)) / total
        sizes.append(Size(size, float(deviation)))
    return sizes


def agree(sizes: Sequence[Size], largest: float) -> bool:
    """Whether none of them is off the fitted size, 1, by more than `largest` beyond its scatter."""
    return all(abs(size.value - 1.0) - DEVIATIONS * size.deviation <= largest for size in sizes)
