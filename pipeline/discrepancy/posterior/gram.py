"""Products of columns when other coefficients are integrated out: all of it is linear algebra on Gram matrices."""

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


def without_nuisance(gram: np.ndarray, columns: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Products in units of noise and nuisance together.

    Args:
        gram: (M + 1, M + 1) of columns in units of the noise, and of the residual as the last.
        columns: (K,) of the nuisance.
        variance: (K,) of its coefficients.
    """
    root = np.sqrt(variance)
    factor = np.linalg.cholesky(np.eye(len(columns)) + root[:, None] * gram[np.ix_(columns, columns)] * root)
    explained = solve_triangular(factor, root[:, None] * gram[columns], lower=True, check_finite=False)
    return np.asarray(gram - explained.T @ explained)


def given(gram: np.ndarray, prior: Prior) -> tuple[np.ndarray, float]:
    """Products beside coefficients that are integrated out, and the log evidence that these add.

    Args:
        gram: (M + 1, M + 1), as of `without_nuisance`.
        prior: Of the coefficients.
    """
    columns, mean, precision, *_ = prior
    if not len(columns):
        return gram, 0.0
    posterior = np.diag(precision) + gram[np.ix_(columns, columns)]
    wanted = gram[columns, -1] + precision * mean
    evidence = 0.5 * wanted @ np.linalg.solve(posterior, wanted) - 0.5 * np.sum(precision * mean**2)
    evidence += 0.5 * np.sum(np.log(precision)) - 0.5 * np.linalg.slogdet(posterior)[1]
    beside = gram.copy()
    beside[:, -1] -= gram[:, columns] @ mean
    beside[-1, :] = beside[:, -1]
    return beside - beside[:, columns] @ np.linalg.solve(posterior, beside[columns]), float(evidence)
