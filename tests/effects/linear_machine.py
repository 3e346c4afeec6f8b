"""A linear f_θ made by hand, and logs of machines that have it and one effect, simulated in float64.

The nominal machine: u ← u + α (c a − u). SiLU(x) − SiLU(−x) = x makes a network with one hidden layer linear.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target

from .conftest import DT_S, LAGS, LOWER, UPPER, make_model, make_trajectory

FULL_SPEED, SHARE = np.array([0.4, 0.08]), 0.3


def linear_model(target: str, share: float = SHARE) -> tuple[DynamicsModel, dict]:
    """The nominal machine as a model with window, and its parameters."""
    model = make_model("mlp", target, hidden=(4,), scale=(1.0, 1.0))
    limit = np.array(model.specification.velocity_limit)
    kernel = np.zeros((model.specification.n_features, 2))
    newest, command = 2 * LAGS, 2 * (2 * LAGS + 1)
    for j in range(2):
        kernel[command + j, j] = share * FULL_SPEED[j]
        if model.specification.target is Target.dqdot:
            kernel[newest + j, j] = -share * limit[j]  # motion is normalised by the limit
        else:  # from the last two positions, normalised by the range: u Δt
            kernel[command + j, j] *= DT_S
            kernel[newest + j, j] = (1 - share) * 0.5 * (UPPER - LOWER)[j]
            kernel[newest - 2 + j, j] = -kernel[newest + j, j]
    first = {
        "kernel": jnp.asarray(np.concatenate([kernel, -kernel], axis=1), jnp.float32),
        "bias": jnp.zeros(4),
    }
    signs = np.concatenate([np.eye(2), -np.eye(2)])
    return model, {
        "layer_0": first,
        "layer_1": {"kernel": jnp.asarray(signs, jnp.float32), "bias": jnp.zeros(2)},
    }


def commands(seed: int, n_rows: int) -> np.ndarray:
    """Holds of a few steps, at rest for the first rows; reversed so that joints stay within their ranges."""
    random = np.random.default_rng(seed)
    a = np.zeros((n_rows, 2))
    for t in range(6, n_rows):
        a[t] = np.where(random.random(2) < 0.12, random.integers(-1, 2, 2), a[t - 1])
    return a


def simulated(
    a: np.ndarray,
    on_command: Callable = lambda t, a: a[t],
    on_velocity: Callable = lambda t, u, v, a, q: u,
    sensor: Callable = lambda q: q,
    sensor_scale: float | np.ndarray = 1.0,
    share: float = SHARE,
):
    """A log of the machine with an effect.

    Args:
        a: (T, 2) commands given.
        on_command: (row, all commands) to the command that reaches the actuator.
        on_velocity: (row, u of the step, last v, command, q before) to v.
        sensor: True to measured position.
        sensor_scale: Its derivative.
        share: α.
    """
    n_rows = len(a)
    q, u, v = np.zeros((n_rows, 2)), np.zeros((n_rows, 2)), np.zeros((n_rows, 2))
    q[0] = 0.5 * (LOWER + UPPER)
    for t in range(n_rows - 1):
        u[t + 1] = u[t] + share * (FULL_SPEED * on_command(t, a) - u[t])
        v[t + 1] = on_velocity(t, u[t + 1], v[t], a[t], q[t])
        q[t + 1] = q[t] + DT_S * v[t + 1]
    return make_trajectory(sensor(q), v * sensor_scale, a)
