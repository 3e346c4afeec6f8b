"""Several steps under one command, with a first layer that sees held commands once instead of row by row.

The first layer of a network is a sum over the rows of its window (`network.py`). Commands that were held for r steps
fill r rows in turn: adding up the kernel's rows that one of them meets, beforehand, leaves a row per held command.
With 18 lags and r = 4 these are 6 rows instead of 19.
"""

from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.stepwise_model import StepwiseModel
from pipeline.dynamics.model.stops import Stops

Array = TypeVar("Array", jax.Array, np.ndarray)


def hold(
    model: StepwiseModel,
    parameters: Parameters,
    history: History,
    command: jax.Array,
    n_steps: int,
    stops: Stops | None = None,
) -> tuple[History, jax.Array]:
    """Advance by `n_steps` under one command; arguments and result as of `Dynamics.hold`, equal up to rounding."""
    network, n_rows = model.network, model.specification.lags + 1
    first, *others = network.layers(parameters)
    window = first.kernel.shape[0] // (2 * n_rows + 1) * n_rows
    by_motion, by_commands, by_q = jnp.split(first.kernel, [window, 2 * window])
    kernels = by_held_commands(by_commands.reshape(n_rows, -1), np.arange(n_rows)[::-1], n_steps)

    recent = network.expand(_flat(held_commands(history, command, n_steps, kernels.shape[1])))
    motion = network.expand(_flat(model.normalise_motion(history.motion)))
    row = motion.shape[-1] // n_rows
    q, newest = history.q, history.motion[..., -1, :]
    visited, appended = [], []
    for kernel in kernels:
        x = jnp.concatenate([motion, recent, network.expand(model.normalise_position(q))], axis=-1)
        y = x @ jnp.concatenate([by_motion, kernel.reshape(-1, by_q.shape[-1]), by_q]) + first.bias
        q, newest, _ = model.finish_step(others, y, q, newest, stops)
        motion = jnp.concatenate([motion[..., row:], network.expand(model.normalise_motion(newest))], axis=-1)
        visited.append(q)
        appended.append(newest)

    return after_hold(history, command, appended, q), jnp.stack(visited)


def held_commands(history: History, command: jax.Array, n_steps: int, n_commands: int) -> jax.Array:
    """(..., n_commands, n_joint): `command`, then those that were held for `n_steps` each before it, newest first."""
    before = history.commands[..., ::-n_steps, :][..., : n_commands - 1, :]
    return jnp.concatenate([command[..., None, :], before], axis=-2)


def after_hold(history: History, command: jax.Array, appended: Sequence[jax.Array], q: jax.Array) -> History:
    """The history after a step under `command` for each appended row of motion (..., n_joint), oldest first."""
    n_rows, n_steps = history.motion.shape[-2], len(appended)
    repeated = jnp.broadcast_to(command[..., None, :], (*command.shape[:-1], n_steps, command.shape[-1]))
    return History(
        motion=jnp.concatenate([history.motion, jnp.stack(appended, axis=-2)], axis=-2)[..., -n_rows:, :],
        commands=jnp.concatenate([history.commands, repeated], axis=-2)[..., -n_rows:, :],
        q=q,
    )


def by_held_commands(rows: Array, steps_ago: np.ndarray, n_steps: int) -> Array:
    """Sums of the kernel's rows that each held command meets, step by step.

    In step s (from 0) the j-th command before the acting one is in the window's rows of n_steps j + s - (n_steps - 1)
    … n_steps j + s steps ago, as far as there are such rows.

    Args:
        rows: (k+1, m), the kernel's values by row of the window of commands.
        steps_ago: (k+1,), age of each row; the acting command's is 0.
        n_steps: that commands are held for.

    Returns:
        (n_steps, commands in the window, m), the acting command first.
    """
    n_commands = 1 + -(-(len(rows) - 1) // n_steps)
    step, command = np.arange(n_steps)[:, None, None], np.arange(n_commands)[:, None]
    meets = (steps_ago - step + n_steps - 1) // n_steps == command
    summed = meets.reshape(-1, len(rows)).astype(rows.dtype) @ rows
    return summed.reshape(n_steps, n_commands, -1)


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, n_joint) to (..., T * n_joint), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
