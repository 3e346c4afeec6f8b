"""Open-loop rollouts: logged commands in, predicted configurations out.

`rollout_by_steps` is the definition, `rollout` the same at less cost, for training and evaluation, where
all commands are known beforehand: rows are normalised and expanded once, not once per window that they lie
in; windows of commands are cut from one buffer; and the first layer is applied to commands and motion
apart, so that back-propagation does not carry gradients to the commands.
"""

import jax
import jax.numpy as jnp

from pipeline.dynamics.features import History
from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters


def rollout_by_steps(
    model: DynamicsModel, parameters: Parameters, history: History, commands: jax.Array
) -> jax.Array:
    """Predict by calling `model.step` once per command.

    Args:
        model: The dynamics model.
        parameters: θ.
        history: Before the first command; leading batch axes (...).
        commands: (..., H, n_joint), a_t … a_{t+H-1}.

    Returns:
        (..., H, n_joint): q̂_{t+1} … q̂_{t+H}, rad or m.
    """

    def advance(history: History, command: jax.Array) -> tuple[History, jax.Array]:
        history = model.step(parameters, history, command)
        return history, history.q

    _, q = jax.lax.scan(advance, history, jnp.moveaxis(commands, -2, 0))
    return jnp.moveaxis(q, 0, -2)


def rollout(model: DynamicsModel, parameters: Parameters, history: History, commands: jax.Array) -> jax.Array:
    """Predict in open loop; arguments and result as of `rollout_by_steps`, equal up to rounding."""
    network = model.network
    row = commands.shape[-1] * network.expansion  # expanded values per row
    window = row * (model.specification.lags + 1)
    kernel = network.first_kernel(parameters)
    motion_kernel, command_kernel, q_kernel = (
        kernel[:window],
        kernel[window : 2 * window],
        kernel[2 * window :],
    )

    # The window of step j holds commands j … j+k of this buffer; the oldest command is in no window any more.
    known = network.expand(_flat(jnp.concatenate([history.commands[..., 1:, :], commands], axis=-2)))

    def advance(
        carry: tuple[jax.Array, jax.Array, jax.Array], step: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], jax.Array]:
        motion, newest, q = carry  # motion: expanded and normalised rows of the window
        first = (
            jax.lax.dynamic_slice_in_dim(known, step * row, window, axis=-1) @ command_kernel
            + motion @ motion_kernel
            + network.expand(model.normalise_position(q)) @ q_kernel
        )
        residual = model.scale_residual(network.remaining(parameters, first))
        q, newest = model.integrate(q, newest, residual)
        appended = network.expand(model.normalise_motion(newest))
        return (jnp.concatenate([motion[..., row:], appended], axis=-1), newest, q), q

    motion = network.expand(_flat(model.normalise_motion(history.motion)))
    initial = (motion, history.motion[..., -1, :], history.q)
    _, q = jax.lax.scan(advance, initial, jnp.arange(commands.shape[-2]))
    return jnp.moveaxis(q, 0, -2)


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, n_joint) to (..., T * n_joint), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
