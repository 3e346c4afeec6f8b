"""Open-loop rollouts: logged commands in, predicted configurations out."""

import jax
import jax.numpy as jnp

from pipeline.dynamics.features import History
from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters


def rollout_by_steps(
    model: DynamicsModel, parameters: Parameters, history: History, commands: jax.Array
) -> jax.Array:
    """Predict by calling `model.step` once per command: the definition that `rollout` is tested against.

    Args:
        model: The dynamics model.
        parameters: θ.
        history: Before the first command; leading batch axes (...).
        commands: (..., H, n_joint), a_t … a_{t+H-1}.

    Returns:
        (..., H, n_joint): q̂_{t+1} … q̂_{t+H}.
    """

    def advance(history: History, command: jax.Array) -> tuple[History, jax.Array]:
        history = model.step(parameters, history, command)
        return history, history.q

    _, q = jax.lax.scan(advance, history, jnp.moveaxis(commands, -2, 0))
    return jnp.moveaxis(q, 0, -2)


def rollout(model: DynamicsModel, parameters: Parameters, history: History, commands: jax.Array) -> jax.Array:
    """Predict q̂_{t+1} … q̂_{t+H} (..., H, n_joint) in open loop under a_t … a_{t+H-1} (..., H, n_joint)."""
    return rollout_by_steps(model, parameters, history, commands)
