"""Errors of a predictor on rows of one purpose, in windows as the contract draws them, with intervals by blocks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.diagnosis.window_starts import starts_within
from pipeline.dynamics.evaluation.errors import Predictor, open_loop_residuals
from pipeline.logs.tuples import Trajectory

BLOCK_ROWS = 400  # of the bootstrap: windows that share rows fall together
RESAMPLES = 400


@dataclass(frozen=True)
class WindowErrors:
    """Squared errors of windows.

    Attributes:
        squares: (n_windows, n_joint) mean over the window's steps, rad² or m².
        block: (n_windows,) number of the bootstrap block.
    """

    squares: np.ndarray
    block: np.ndarray

    @property
    def rmse(self) -> np.ndarray:
        """(n_joint,) rad or m; NaN without windows."""
        if len(self.squares) == 0:
            return np.full(self.squares.shape[1], np.nan)
        return np.sqrt(self.squares.mean(axis=0))

    def interval(self, seed: int = 0) -> np.ndarray:
        """(2, n_joint) 95 % interval of the RMSE, by resampling blocks."""
        if len(self.squares) == 0:
            return np.full((2, self.squares.shape[1]), np.nan)
        return np.sqrt(np.quantile(self._resampled(self.squares, seed), (0.025, 0.975), axis=0))

    def improvement(self, other: "WindowErrors", seed: int = 0) -> np.ndarray:
        """(RESAMPLES, n_joint) resampled 1 − squares / squares of `other`."""
        return 1.0 - self._resampled(self.squares, seed) / self._resampled(other.squares, seed)

    def _resampled(self, squares: np.ndarray, seed: int) -> np.ndarray:
        blocks, index = np.unique(self.block, return_inverse=True)
        sums = np.stack([np.bincount(index, column, minlength=len(blocks)) for column in squares.T], axis=1)
        counts = np.bincount(index, minlength=len(blocks))
        drawn = np.random.default_rng(seed).integers(len(blocks), size=(RESAMPLES, len(blocks)))
        return sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)[:, None]


def window_errors(
    predictor: Predictor, trajectories: Sequence[Trajectory], allowed: Sequence[np.ndarray], horizon: int
) -> WindowErrors:
    """Errors over all windows of `horizon` steps that lie in the allowed rows of the trajectories."""
    squares, blocks, first = [np.zeros((0, trajectories[0].q.shape[1]))], [np.zeros(0, int)], 0
    for trajectory, rows in zip(trajectories, allowed, strict=True):
        starts = starts_within(rows, horizon)
        if len(starts):
            residuals = open_loop_residuals(predictor, trajectory, starts, horizon)
            squares.append(np.mean(residuals**2, axis=1))
            blocks.append(first + starts // BLOCK_ROWS)
        first += len(trajectory) // BLOCK_ROWS + 1
    return WindowErrors(np.concatenate(squares), np.concatenate(blocks))
