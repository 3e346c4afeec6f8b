"""Several steps under one command, with a first layer that sees held commands once instead of row by row.

The first layer of a network is a sum over the rows of its window (`network.py`). Commands that were held for r steps
fill r rows in turn: adding up the kernel's rows that one of them meets, beforehand, leaves a row per held command.
With 18 lags and r = 4 these are 6 rows instead of 19.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters

Correction = Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]


def hold(
    model: DynamicsModel,
    parameters: Parameters,
    history: History,
    command: jax.Array,
    n_steps: int,
    correct: Correction,
) -> tuple[History, jax.Array]:
    """Advance by `n_steps` under `command`; equal, up to rounding, to as many calls of `model.step`.

    Args:
        model: the dynamics model.
        parameters: θ.
        history: before the command; any leading axes. Its commands were held like this one: from the newest row
            back, every `n_steps` rows are equal.
        command: a, (..., n_joint).
        n_steps: steps that it is held for.
        correct: applied after each step to q and the newest row of the motion, each (..., n_joint): end stops.

    Returns:
        The history after the last step, and q after each, (n_steps, ..., n_joint), rad or m.
    """
    network, n_rows = model.network, model.specification.lags + 1
    first, *others = network.layers(parameters)
    window = first.kernel.shape[0] // (2 * n_rows + 1) * n_rows
    by_motion, by_commands, by_q = jnp.split(first.kernel, [window, 2 * window])
    kernels = _by_held_commands(by_commands, n_rows, n_steps)

    held_before = history.commands[..., ::-n_steps, :][..., : kernels.shape[1] - 1, :]
    held = jnp.concatenate([command[..., None, :], held_before], axis=-2)
    recent = network.expand(_flat(held))
    motion = network.expand(_flat(model.normalise_motion(history.motion)))
    row = motion.shape[-1] // n_rows
    q, newest = history.q, history.motion[..., -1, :]
    visited, appended = [], []
    for kernel in kernels:
        x = jnp.concatenate([motion, recent, network.expand(model.normalise_position(q))], axis=-1)
        y = x @ jnp.concatenate([by_motion, kernel.reshape(-1, kernel.shape[-1]), by_q]) + first.bias
        for layer in others:
            y = network.activate(y) @ layer.kernel + layer.bias
        q, newest = correct(*model.integrate(q, newest, model.scale_residual(y)))
        motion = jnp.concatenate([motion[..., row:], network.expand(model.normalise_motion(newest))], axis=-1)
        visited.append(q)
        appended.append(newest)

    repeated = jnp.broadcast_to(command[..., None, :], (*command.shape[:-1], n_steps, command.shape[-1]))
    after = History(
        motion=jnp.concatenate([history.motion, jnp.stack(appended, axis=-2)], axis=-2)[..., -n_rows:, :],
        commands=jnp.concatenate([history.commands, repeated], axis=-2)[..., -n_rows:, :],
        q=q,
    )
    return after, jnp.stack(visited)


def _by_held_commands(by_commands: jax.Array, n_rows: int, n_steps: int) -> jax.Array:
    """Sums of the kernel's rows that each held command meets, step by step.

    In step s (from 0) the j-th command before the acting one is in the window's rows of n_steps j + s - (n_steps - 1)
    … n_steps j + s steps ago, as far as there are such rows.

    Args:
        by_commands: (n_rows · expanded row, width), oldest first.
        n_rows: k + 1.
        n_steps: that commands are held for.

    Returns:
        (n_steps, commands in the window, expanded row, width), the acting command first.
    """
    n_commands = 1 + -(-(n_rows - 1) // n_steps)
    steps_ago = np.arange(n_rows)[::-1]
    meets = np.stack(
        [
            (steps_ago - step + n_steps - 1) // n_steps == j
            for step in range(n_steps)
            for j in range(n_commands)
        ]
    )
    summed = jnp.asarray(meets, by_commands.dtype) @ by_commands.reshape(n_rows, -1)
    return summed.reshape(n_steps, n_commands, -1, by_commands.shape[-1])


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, n_joint) to (..., T * n_joint), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
