"""Several steps under one command, without rolling the window from step to step.

The first layer of a network is a sum over the rows of its window (`network.py`), so its parts separate:

- Commands that were held for r steps fill r rows in turn. Adding up the kernel's rows that one of them meets,
  beforehand, leaves a row per held command: with 18 lags and r = 4 these are 6 rows instead of 19.
- What is known before the first step, commands and past motion, contributes to all r steps by one matrix product.
- What is predicted on the way, at most r - 1 rows and the configuration, is all that a step adds by itself.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.features import History
from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters

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
    by_held = _by_held_commands(by_commands, n_rows, n_steps)

    held_before = history.commands[..., ::-n_steps, :][..., : by_held.shape[0] - 1, :]
    held = jnp.concatenate([command[..., None, :], held_before], axis=-2)
    known = [network.expand(_flat(rows)) for rows in (model.normalise_motion(history.motion), held)]
    kernel = jnp.concatenate([_by_known_motion(by_motion, n_rows, n_steps), _flat_rows(by_held)])
    from_known = jnp.concatenate(known, axis=-1) @ kernel

    q, newest, width = history.q, history.motion[..., -1, :], first.bias.shape[0]
    visited: list[jax.Array] = []
    appended: list[jax.Array] = []
    predicted: list[jax.Array] = []  # normalised and expanded
    for step in range(n_steps):
        recent = predicted[-n_rows:]
        x = jnp.concatenate([*recent, network.expand(model.normalise_position(q))], axis=-1)
        by_recent = by_motion[window - sum(row.shape[-1] for row in recent) :]
        y = from_known[..., step * width : (step + 1) * width] + first.bias
        y = y + x @ jnp.concatenate([by_recent, by_q])
        for layer in others:
            y = network.activate(y) @ layer.kernel + layer.bias
        q, newest = correct(*model.integrate(q, newest, model.scale_residual(y)))
        predicted.append(network.expand(model.normalise_motion(newest)))
        visited.append(q)
        appended.append(newest)

    repeated = jnp.broadcast_to(command[..., None, :], (*command.shape[:-1], n_steps, command.shape[-1]))
    after = History(
        motion=jnp.concatenate([history.motion, jnp.stack(appended, axis=-2)], axis=-2)[..., -n_rows:, :],
        commands=jnp.concatenate([history.commands, repeated], axis=-2)[..., -n_rows:, :],
        q=q,
    )
    return after, jnp.stack(visited)


def _by_known_motion(by_motion: jax.Array, n_rows: int, n_steps: int) -> jax.Array:
    """Kernel of the rows of motion that are known before the first step: in step s they are s rows further back.

    Args:
        by_motion: (n_rows · expanded row, width), oldest first.
        n_rows: k + 1.
        n_steps: steps to come.

    Returns:
        (n_rows · expanded row, n_steps · width).
    """
    row = by_motion.shape[0] // n_rows
    shifted = [jnp.pad(by_motion, ((step * row, 0), (0, 0)))[: n_rows * row] for step in range(n_steps)]
    return jnp.concatenate(shifted, axis=-1)


def _by_held_commands(by_commands: jax.Array, n_rows: int, n_steps: int) -> jax.Array:
    """Sums of the kernel's rows that each held command meets, step by step.

    In step s (from 0) the j-th command before the acting one is in the window's rows of n_steps j + s - (n_steps - 1)
    … n_steps j + s steps ago, as far as there are such rows.

    Args:
        by_commands: (n_rows · expanded row, width), oldest first.
        n_rows: k + 1.
        n_steps: that commands are held for.

    Returns:
        (commands in the window, expanded row, n_steps · width), the acting command first.
    """
    n_commands = 1 + -(-(n_rows - 1) // n_steps)
    steps_ago = np.arange(n_rows)[::-1]
    meets = np.stack(
        [
            (steps_ago - step + n_steps - 1) // n_steps == j
            for j in range(n_commands)
            for step in range(n_steps)
        ]
    )
    summed = jnp.asarray(meets, by_commands.dtype) @ by_commands.reshape(n_rows, -1)
    by_step = summed.reshape(n_commands, n_steps, -1, by_commands.shape[-1])
    return jnp.swapaxes(by_step, 1, 2).reshape(n_commands, by_step.shape[2], -1)


def _flat_rows(kernel: jax.Array) -> jax.Array:
    """(commands, expanded row, width) to (commands * expanded row, width)."""
    return kernel.reshape(-1, kernel.shape[-1])


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, n_joint) to (..., T * n_joint), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
