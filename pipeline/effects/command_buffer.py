"""Delay of commands by any time, also a fraction of a step; differentiable in the delay."""

import jax
import jax.numpy as jnp

LONGEST_STEPS = 16  # 0.8 s at 20 Hz


def initial_buffer(batch: tuple[int, ...], n_joint: int) -> jax.Array:
    """No commands so far: (..., LONGEST_STEPS, n_joint), newest first."""
    return jnp.zeros((*batch, LONGEST_STEPS, n_joint))


def delayed(buffer: jax.Array, command: jax.Array, delay_steps: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Push `command` and read the command of `delay_steps` ago, linear between steps.

    Args:
        buffer: (..., LONGEST_STEPS, n_joint), newest first.
        command: (..., n_joint).
        delay_steps: (n_joint,), in steps, clipped to the buffer.

    Returns:
        The new buffer, and (..., n_joint).
    """
    known = jnp.concatenate([command[..., None, :], buffer], axis=-2)
    steps = jnp.arange(LONGEST_STEPS + 1)[:, None]
    # Clipping or hat functions would have wrong derivatives at a whole number of steps, including zero. This form has
    # the derivative towards longer delays. At a whole number exactly one weight is one.
    late = jnp.where(
        delay_steps > LONGEST_STEPS, 1.0 * LONGEST_STEPS, jnp.where(delay_steps < 0.0, 0.0, delay_steps)
    )
    whole = jnp.floor(late)
    part = (late - whole)[..., None, :]
    newer = whole.astype(steps.dtype)[..., None, :]
    weights = jnp.where(steps == newer, 1.0 - part, jnp.where(steps == newer + 1, part, 0.0))
    return known[..., :-1, :], jnp.sum(known * weights, axis=-2)
