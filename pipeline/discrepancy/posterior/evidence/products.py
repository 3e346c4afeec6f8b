"""Products of columns when other coefficients are integrated out: all of it is linear algebra.

A product of two columns is that of their rows, less that of what nuisance and given effects explain of them. Only the
products that somebody asks for are computed: of hundreds of terms each has a few columns.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular


class Prior(NamedTuple):
    """Normal prior of some coefficients.

    Attributes:
        columns: (k,) of the matrix.
        mean: (k,).
        precision: (k,).
        lower: (k,) bounds.
        upper: (k,) bounds.
    """

    columns: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


NO_COEFFICIENTS = Prior(np.zeros(0, int), *np.zeros((4, 0)))


class Products(NamedTuple):
    """Of M columns, and of the residual as the last, in units of noise and nuisance together.

    Attributes:
        rows: (N, M + 1) in units of the noise.
        explained: (K, M + 1) whose products are those of what is integrated out.
    """

    rows: np.ndarray
    explained: np.ndarray

    def of(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """(n,) products of n pairs of columns."""
        return np.asarray(
            _products(self.rows, one, other).astype(float) - _products(self.explained, one, other)
        )

    def of_terms(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Information (n, k, k) and score (n, k) of n terms with k columns each, (n, k)."""
        n, k = columns.shape
        information = np.empty((n, k, k))
        for i in range(k):
            for j in range(i + 1):
                information[:, i, j] = information[:, j, i] = self.of(columns[:, i], columns[:, j])
        last = np.full(n, self.rows.shape[1] - 1)
        return information, np.stack([self.of(columns[:, i], last) for i in range(k)], axis=1)

    def beside(self, prior: Prior) -> "Products":
        """Products beside coefficients that are integrated out, too."""
        columns, mean, precision, *_ = prior
        if not len(columns):
            return self
        rows, explained = self.rows.copy(), self.explained.copy()
        for of in (rows, explained):
            of[:, -1] -= of[:, columns] @ mean.astype(of.dtype)
        cross = (rows[:, columns].T @ rows).astype(float) - explained[:, columns].T @ explained
        factor = np.linalg.cholesky(np.diag(precision) + cross[:, columns])
        return Products(
            rows, np.concatenate([explained, solve_triangular(factor, cross, lower=True, check_finite=False)])
        )


def beside_nuisance(sessions: Sequence[np.ndarray], columns: np.ndarray, variance: np.ndarray) -> Products:
    """Products beside a nuisance of each session's own.

    Args:
        sessions: Per session (N, M + 1) columns and residual in units of the noise.
        columns: (K,) of the nuisance.
        variance: (K,) of its coefficients.
    """
    root, explained = np.sqrt(variance), []
    for rows in sessions:
        cross = root[:, None] * (rows[:, columns].T @ rows).astype(float)
        factor = np.linalg.cholesky(np.eye(len(columns)) + cross[:, columns] * root)
        explained.append(solve_triangular(factor, cross, lower=True, check_finite=False))
    # Column by column: products are of single columns.
    return Products(np.asfortranarray(np.concatenate(sessions)), np.asfortranarray(np.concatenate(explained)))


def _products(rows: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("an,an->a", rows.T[one], rows.T[other]))
