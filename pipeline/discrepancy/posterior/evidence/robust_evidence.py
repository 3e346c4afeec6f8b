"""The evidence of a whole explanation under heavy-tailed noise, by Laplace's method.

    log p(r) ≈ Σ_t log t_ν(e_t / g) + log N(β; μ, S) + Σ_s log N(b_s; 0, V) − ½ log |H|

e_t is what is left of row t, g ≥ 1 how much noisier the measured logs are than nominal ones. Coefficients are found by
reweighted least squares, and H has the weights in the place of second derivatives. A few rows that no effect explains,
such as a person who pushes the arm, count little then. Source: Tierney and Kadane (1986), Accurate approximations for
posterior moments; weights: Lange, Little and Taylor (1989).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from pipeline.discrepancy.posterior.evidence.products import Prior

ITERATIONS = 5  # from the prior's mean on; further ones change the evidence by less than 0.1


class Block(NamedTuple):
    """Rows of one joint in one session.

    Attributes:
        effects: (N, k) columns of the explanation, whitened; all arrays may be of single precision.
        nuisance: (N, K) columns of what varies, scaled to standard deviations of one.
        residual: (N,) whitened.
        degrees: Of the noise.
        scale: Of the noise.
    """

    effects: np.ndarray
    nuisance: np.ndarray
    residual: np.ndarray
    degrees: float
    scale: float


class Fit(NamedTuple):
    """Outcome.

    Attributes:
        evidence: Log, but for a constant that depends on the rows alone.
        likelihood: The same at the coefficients; the nuisance alone is integrated out.
        coefficients: (k,) most probable ones within their bounds.
        noisier: g.
        weights: Per block (N,) how much a row counts, in units of its whitened variance.
    """

    evidence: float
    likelihood: float
    coefficients: np.ndarray
    noisier: float
    weights: list[np.ndarray]


def fit(blocks: Sequence[Block], prior: Prior, noisier: float | None = None) -> Fit:
    """Fit coefficients that all blocks share, beside a nuisance of each block's own.

    Args:
        blocks: Rows.
        prior: Of the k coefficients; its columns are not used.
        noisier: g, where it is known.
    """
    mean, precision = prior.mean, prior.precision
    shared, own = mean.copy(), [np.zeros(block.nuisance.shape[1]) for block in blocks]
    is_known, noisier = noisier is not None, noisier or 1.0
    for iteration in range(ITERATIONS):
        errors = [
            b.residual - b.effects @ shared - b.nuisance @ of for b, of in zip(blocks, own, strict=True)
        ]
        if iteration and not is_known:
            noisier = _noisier(blocks, errors, noisier)
        hessian, wanted, factors = np.diag(precision), precision * mean, []
        log_determinant = 0.0
        for block, error in zip(blocks, errors, strict=True):
            weight = (_weight(error, block, noisier) / (noisier * block.scale) ** 2).astype(np.float32)
            weighted = block.nuisance * weight[:, None]
            information = (weighted.T @ block.nuisance).astype(float)
            factor = np.linalg.cholesky(information + np.eye(len(information)))
            both = np.column_stack([block.effects, block.residual])
            solved = solve_triangular(factor, weighted.T @ both, lower=True, check_finite=False)
            of_effects, of_residual = solved[:, :-1], solved[:, -1]
            effects = block.effects * weight[:, None]
            hessian = hessian + effects.T @ block.effects - of_effects.T @ of_effects
            wanted = wanted + effects.T @ block.residual - of_effects.T @ of_residual
            log_determinant += 2.0 * float(np.log(np.diag(factor)).sum())
            factors.append((factor, of_effects, of_residual))
        shared = np.clip(np.linalg.solve(hessian, wanted), prior.lower, prior.upper)
        own = [
            solve_triangular(
                factor, of_residual - of_effects @ shared, trans="T", lower=True, check_finite=False
            )
            for factor, of_effects, of_residual in factors
        ]
    weights = []
    likelihood = -0.5 * log_determinant
    for block, of in zip(blocks, own, strict=True):
        error = block.residual - block.effects @ shared - block.nuisance @ of
        likelihood += _log_likelihood(error, block, noisier) - 0.5 * float(of @ of)
        weights.append(_weight(error, block, noisier) / (noisier * block.scale) ** 2)
    evidence = likelihood - 0.5 * np.linalg.slogdet(hessian)[1]
    evidence += 0.5 * np.sum(np.log(precision) - precision * (shared - mean) ** 2)
    return Fit(float(evidence), float(likelihood), shared, noisier, weights)


def _log_likelihood(error: np.ndarray, block: Block, noisier: float) -> float:
    """Of what is left of a block's rows, but for a constant."""
    z = error / (noisier * block.scale)
    return float(
        -0.5 * (block.degrees + 1.0) * np.sum(np.log1p(z**2 / block.degrees)) - len(z) * np.log(noisier)
    )


def _weight(error: np.ndarray, block: Block, noisier: float) -> np.ndarray:
    z = error / (noisier * block.scale)
    return (block.degrees + 1.0) / (block.degrees + z**2)


def _noisier(blocks: Sequence[Block], errors: Sequence[np.ndarray], before: float) -> float:
    """Next estimate of g."""
    squares = sum(
        float(np.sum(_weight(error, block, before) * (error / block.scale) ** 2))
        for block, error in zip(blocks, errors, strict=True)
    )
    return max(float(np.sqrt(squares / max(sum(map(len, errors)), 1))), 1.0)
