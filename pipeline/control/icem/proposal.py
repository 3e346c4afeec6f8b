"""The distribution that sequences are sampled from, and how it follows the elites."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.stats import norm

from pipeline.control.icem.config import Bounds

_SMALLEST_STD = 1e-6  # a quantile needs a width to be taken of
_EXTREME_QUANTILE = (
    1e-6  # keeps quantiles off 0 and 1, where the normal distribution's are infinite in float32
)


class Proposal(NamedTuple):
    """Gaussian over proto-action sequences with diagonal covariance, each field (H, n_joint)."""

    mean: jax.Array
    std: jax.Array


def sample_within_bounds(proposal: Proposal, noise: jax.Array, bounds: Bounds) -> jax.Array:
    """Samples within [-1, 1] from noise of unit variance, both (N, H, n_joint).

    Clipped, what exceeds a bound lies on it. Truncated, every entry has the distribution of the Gaussian cut off at
    the bounds: the sample is the cut distribution's value at the noise's quantile.
    """
    mean, std = proposal
    if bounds is Bounds.clip:
        return jnp.clip(mean + std * noise, -1.0, 1.0)
    std = jnp.maximum(std, _SMALLEST_STD)
    lowest, highest = norm.cdf((-1.0 - mean) / std), norm.cdf((1.0 - mean) / std)
    quantile = lowest + norm.cdf(noise) * (highest - lowest)
    sample = mean + std * norm.ppf(jnp.clip(quantile, _EXTREME_QUANTILE, 1.0 - _EXTREME_QUANTILE))
    return jnp.clip(sample, -1.0, 1.0)  # only rounding is left to clip


def refit(proposal: Proposal, elites: jax.Array, momentum: float) -> Proposal:
    """α old + (1 - α) new, of mean and of standard deviation; elites (K, H, n_joint)."""
    new = Proposal(elites.mean(axis=0), elites.std(axis=0))
    return jax.tree.map(lambda old, new: momentum * old + (1.0 - momentum) * new, proposal, new)


def shift(entries: jax.Array, n: int, last: jax.Array) -> jax.Array:
    """Entries (..., H, n_joint) without their first `n`, and `last` (..., n, n_joint) appended."""
    return jnp.concatenate([entries[..., n:, :], jnp.broadcast_to(last, entries[..., :n, :].shape)], axis=-2)
