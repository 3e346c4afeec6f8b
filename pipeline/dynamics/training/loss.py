"""The training loss (paper, Eq. dmodel_loss_function)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.training.windows import Window

Loss = Callable[[Parameters, Window, jax.Array], jax.Array]
"""A scalar of the parameters, a batch of windows, and their start rows."""


def open_loop_loss(
    model: DynamicsModel,
    parameters: Parameters,
    history: History,
    commands: jax.Array,
    q: jax.Array,
    error_scale: jax.Array,
) -> jax.Array:
    """L(θ): squared error norm of the open-loop prediction, averaged over the horizon and the batch.

    Args:
        model: The dynamics model.
        parameters: θ.
        history: At t_i, batch (B, ...).
        commands: (B, H, n_joint), a_{t_i} … a_{t_i+H-1}.
        q: (B, H, n_joint), measured q_{t_i+1} … q_{t_i+H}.
        error_scale: (n_joint,), divisor of errors: one if all joints share a unit, as in the paper, else the joint
            ranges (`MachineSpecification.error_scale`).

    Returns:
        Scalar, rad² (or m², or 1).
    """
    error = (model.roll_out(parameters, history, commands) - q) / error_scale.astype(q.dtype)
    return jnp.mean(jnp.sum(error**2, axis=-1))


def prediction_loss(model: DynamicsModel, error_scale: np.ndarray) -> Loss:
    """`open_loop_loss` of this model, whatever the start rows."""
    return lambda parameters, window, starts: open_loop_loss(
        model, parameters, *window, jnp.asarray(error_scale)
    )
