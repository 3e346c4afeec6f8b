"""Least squares of residuals on a candidate's tangents, judged on rows that it was not fitted on."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

SHOWN_T, SURE_T = 1.5, 2.5  # of `t_statistic`: by chance it is beyond in 7 and 0.6 %, if blocks are normal


class CrossValidatedFit(NamedTuple):
    """How well a candidate explains one joint's residual.

    Attributes:
        coefficients: (k,) fitted on all rows given.
        gain: Held-out reduction of the sum of squares: fitted on one fold, counted on the other, both ways.
        gain_by_block: The same, per block.
        after: (N,) what is left of each row, by the coefficients fitted on the other fold.
    """

    coefficients: np.ndarray
    gain: float
    gain_by_block: np.ndarray
    after: np.ndarray


class Folds(NamedTuple):
    """Rows in use.

    Attributes:
        fold: (N,) 0 or 1.
        block: (N,) number of the block, for the bootstrap.
        n_blocks: Number of blocks.
    """

    fold: np.ndarray
    block: np.ndarray
    n_blocks: int


def evidence(
    reference: np.ndarray,
    residual: np.ndarray,
    regressors: np.ndarray,
    folds: Folds,
    lower: np.ndarray,
    upper: np.ndarray,
    ridge: np.ndarray | float = 0.0,
) -> CrossValidatedFit:
    """Fit `residual` on `regressors`, bounded, and count what that takes off the squares of `reference`.

    Args:
        reference: (N,) residual without the candidate.
        residual: (N,) residual with the candidate, its linear coefficients at zero.
        regressors: (N, k); k may be 0.
        folds: Of the rows.
        lower: (k,) bounds of the coefficients.
        upper: (k,) bounds.
        ridge: (k,) see `bounded_least_squares`.
    """
    k = regressors.shape[1]
    after = residual.copy()
    if k:
        for held_out in (0, 1):
            used = folds.fold != held_out
            coefficients = bounded_least_squares(regressors[used], residual[used], lower, upper, ridge)
            after[~used] = residual[~used] - regressors[~used] @ coefficients
        coefficients = bounded_least_squares(regressors, residual, lower, upper, ridge)
    else:
        coefficients = np.zeros(0)
    by_block = np.bincount(folds.block, reference**2 - after**2, minlength=folds.n_blocks)
    return CrossValidatedFit(coefficients, float(by_block.sum()), by_block, after)


def t_statistic(by_block: np.ndarray) -> float:
    """Sum of the blocks' gains over its standard error; by_block: (n_blocks,)."""
    spread = np.std(by_block, ddof=1) * np.sqrt(len(by_block))
    return float(by_block.sum() / max(spread, 1e-12))


def bounded_least_squares(
    a: np.ndarray, b: np.ndarray, lower: np.ndarray, upper: np.ndarray, ridge: np.ndarray | float = 0.0
) -> np.ndarray:
    """The x (k,) between bounds (k,) that makes |a x - b|² + ridge · x² least.

    Besides, a vanishing ridge keeps what is not excited at zero.

    Args:
        a: (N, k).
        b: (N,).
        lower: At most zero.
        upper: At least zero.
        ridge: (k,) squares of b that an x of one has to explain to be half believed.
    """
    gram = a.T @ a + np.diag(np.broadcast_to(ridge, a.shape[1:]))
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    gram = gram / np.outer(scale, scale) + 1e-6 * np.eye(len(gram))
    solution = np.linalg.solve(gram, a.T @ b / scale) / scale
    if np.all((solution >= lower) & (solution <= upper)):
        return solution
    factor = np.linalg.cholesky(gram)
    target = np.linalg.solve(factor, a.T @ b / scale)
    result = lsq_linear(factor.T, target, bounds=(lower * scale - 1e-12, upper * scale + 1e-12))
    return np.clip(result.x / scale, lower, upper)
