"""The training loss of a nonlinear finite-impulse-response model: its members learn from logs, f from their mean."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.features import push
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.training.loss import Loss
from pipeline.dynamics.training.windows import Window
from pipeline.errors import InputError


def part_bounds(starts: np.ndarray, n_parts: int) -> np.ndarray:
    """Start rows at which the second and each further part of the windows begin: consecutive, of about equal number.

    Raises:
        InputError: There are fewer windows than parts.
    """
    if len(starts) < n_parts:
        raise InputError(
            f"identify: {len(starts)} training rows are too few for an ensemble of {n_parts}; record longer"
        )
    return starts[np.arange(1, n_parts) * len(starts) // n_parts]


def ensemble_loss(model: FirModel, bounds: np.ndarray) -> Loss:
    """What an ensemble and f are trained by, on windows of one step.

    Nothing measured but the configuration goes into a step, so an error of one step is an error of the output: a
    member learns the displacement from each row to the next. No member learns from its own part of the rows. f learns
    the members' mean, at the configurations of the rows and at those of other rows.

    Joints count alike: errors are divided by how far a joint moves in a step.

    Args:
        bounds: Of the parts, `part_bounds`.
    """
    n_members, dt_s = model.specification.members, model.specification.dt_s
    speed = np.asarray(model.specification.residual_scale, np.float32)

    def loss(parameters: Parameters, window: Window, starts: jax.Array) -> jax.Array:
        q, n = window.history.q, len(starts)
        commands = push(window.history.commands, window.commands[:, 0])
        inputs = model.inputs(jnp.tile(commands, (2, 1, 1)), jnp.concatenate([q, jnp.roll(q, 1, axis=0)]))
        velocities = model.members_velocity(parameters, inputs)
        stops = model.own_stops(q)
        moved = q + dt_s * velocities[:, :n]
        if stops is not None:
            moved = jnp.clip(moved, stops.lower, stops.upper)
        errors = jnp.mean(((moved - window.q[:, 0]) / (dt_s * speed)) ** 2, axis=-1)  # (M, B)
        learns = jnp.searchsorted(jnp.asarray(bounds), starts, side="right") != jnp.arange(n_members)[:, None]
        mean = jax.lax.stop_gradient(jnp.mean(velocities, axis=0))
        own = model.velocity(parameters, inputs)
        return jnp.sum(jnp.mean(learns * errors, axis=-1)) + jnp.mean(((own - mean) / speed) ** 2)

    return loss
