"""The evidence of every single term at once, in closed form: how much more probable the residual is with it.

    log ∫ N(r; X β, Σ) N(β; μ, S) dβ − log N(r; 0, Σ),     Σ: noise and nuisance

Coefficients beyond their bounds are taken at them (Laplace's method). Effects are of no known size, so linear
coefficients have three standard deviations, equally probable.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from pipeline.discrepancy.posterior.evidence.products import Products
from pipeline.discrepancy.posterior.residual.columns import Term

SIZES = (1.0 / 3.0, 1.0, 3.0)  # times the usual one


def term_evidence(products: Products, terms: Sequence[Term]) -> np.ndarray:
    """(n_terms,) log Bayes factor of each term over none.

    Args:
        products: Of their columns.
        terms: Of the columns.
    """
    result = np.empty(len(terms))
    of_length: dict[int, list[int]] = defaultdict(list)
    for index, term in enumerate(terms):
        of_length[len(term.columns)].append(index)
    for indices in of_length.values():
        of = [terms[index] for index in indices]
        columns, mean, scale, lower, upper = (
            np.array([getattr(term, name) for term in of])
            for name in ("columns", "mean", "scale", "lower", "upper")
        )
        squares = products.of_terms(columns)
        by_size = [
            _evidence(*squares, mean, np.where(mean == 0.0, size * scale, scale), lower, upper)
            for size in SIZES
        ]
        result[indices] = logsumexp(by_size, axis=0) - np.log(len(SIZES))
    return result


def _evidence(
    information: np.ndarray,
    score: np.ndarray,
    mean: np.ndarray,
    scale: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """(n,) of n terms with k coefficients: (n, k, k), and (n, k) else."""
    precision = scale**-2
    posterior = information + precision[:, None, :] * np.eye(scale.shape[1])
    wanted = score + precision * mean
    found = np.clip(np.linalg.solve(posterior, wanted[..., None])[..., 0], lower, upper)
    squares = np.einsum("ni,nij,nj->n", found, posterior, found)
    evidence = np.sum(wanted * found - 0.5 * precision * mean**2 + 0.5 * np.log(precision), axis=1)
    evidence -= 0.5 * (squares + np.linalg.slogdet(posterior)[1])
    return np.asarray(evidence)
