"""From continuous proto-actions to the machine's commands (paper, Eq. proto_discretization)."""

import jax
import jax.numpy as jnp

from pipeline.machine.specification import CommandKind

PROTO_ACTION_THRESHOLD = 0.5  # Eq. proto_discretization; larger components give a full command


def discretise(proto_action: jax.Array) -> jax.Array:
    """Command in {-1, 0, 1} per joint; a component of exactly ±0.5 is 0.

    Args:
        proto_action: a^p, shape (..., n_joint), in [-1, 1].

    Returns:
        a, same shape and type.
    """
    acts = jnp.abs(proto_action) > PROTO_ACTION_THRESHOLD
    return jnp.where(acts, jnp.sign(proto_action), jnp.zeros_like(proto_action))


def command_from_proto_action(kind: CommandKind, proto_action: jax.Array) -> jax.Array:
    """Command of a machine with discrete or continuous commands: discretised, or clipped to [-1, 1]."""
    if kind is CommandKind.discrete:
        return discretise(proto_action)
    return jnp.clip(proto_action, -1.0, 1.0)
