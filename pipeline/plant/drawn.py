"""Random numbers, drawn many at once."""

from collections.abc import Callable

import numpy as np

DRAWN_AT_ONCE = 256


class Rows:
    """Rows of a stream of its own: the same whether they are taken one by one or together."""

    def __init__(self, draw: Callable[[tuple[int, int]], np.ndarray], width: int) -> None:
        """Rows of so many numbers; `draw` gives an array of a shape, as a generator's methods do."""
        self._draw, self._width = draw, width
        self._rows, self._n_taken = np.empty((0, width)), 0

    def take(self, n: int) -> np.ndarray:
        """The next n rows, (n, width)."""
        first, self._n_taken = self._n_taken, self._n_taken + n
        if self._n_taken > len(self._rows):
            left = self._rows[first:]
            more = self._draw((max(n - len(left), DRAWN_AT_ONCE), self._width))
            self._rows, first, self._n_taken = np.concatenate([left, more]), 0, n
        return self._rows[first : self._n_taken]
