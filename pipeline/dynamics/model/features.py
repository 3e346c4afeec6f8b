"""The approximate state x̃ (paper, Eqs. min_max_normalization, x_t_pos, x_t_vel) and the window behind it.

How the paper's indices are read: at step t the dynamics' window holds commands up to a_t, the one about to
act, and velocities up to the newest estimate. The policy decides a_t, so its x̃ holds commands up to
a_{t-1}. `History` is what is known before a_t: `DynamicsModel.features(history)` is the policy's x̃,
`DynamicsModel.step` pushes a_t first.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike


class History(NamedTuple):
    """What is known at step t before the command a_t is chosen; any leading batch axes.

    Attributes:
        motion: (..., k+1, n_joint), oldest first. Target dqdot: velocity estimates up to the newest, rad/s
            or m/s. Target dq: positions q_{t-k..t}, rad or m.
        commands: (..., k+1, n_joint), a_{t-1-k..t-1}, oldest first, in [-1, 1].
        q: (..., n_joint), the current configuration q_t, rad or m.
    """

    motion: jax.Array
    commands: jax.Array
    q: jax.Array


def min_max(value: jax.Array, lower: ArrayLike, upper: ArrayLike) -> jax.Array:
    """Map [lower, upper] to [-1, 1] per joint (Eq. min_max_normalization); last axis: joints."""
    lower = jnp.asarray(lower, value.dtype)
    upper = jnp.asarray(upper, value.dtype)
    return 2.0 * (value - lower) / (upper - lower) - 1.0


def approximate_state(motion: jax.Array, commands: jax.Array, q: jax.Array) -> jax.Array:
    """x̃ of dimension 2n(k+1) + n from normalised motion, commands and the normalised current configuration.

    Args:
        motion: (..., k+1, n_joint), normalised, oldest first.
        commands: (..., k+1, n_joint), oldest first.
        q: (..., n_joint), normalised.

    Returns:
        (..., 2n(k+1) + n): time-major flattening, as in Eqs. x_t_pos and x_t_vel.
    """
    batch = q.shape[:-1]
    return jnp.concatenate([motion.reshape(*batch, -1), commands.reshape(*batch, -1), q], axis=-1)


def push(window: jax.Array, newest: jax.Array) -> jax.Array:
    """Drop the oldest row of (..., k+1, n_joint) and append `newest` (..., n_joint)."""
    return jnp.concatenate([window[..., 1:, :], newest[..., None, :]], axis=-2)
