"""Gradients: of the H-step loss against finite differences, of `rollout` against those of its definition."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.rollouts.open_loop import rollout
from pipeline.dynamics.training.loss import open_loop_loss
from tests.dynamics.conftest import make_specification, random_trajectory

STEP = 1e-5  # central differences in float64: truncation and rounding errors are both about 1e-10


def rows(model, horizon, batch=()):
    """q, qd, a of a random log with leading axes `batch`, NumPy float64."""
    n_rows, size = model.specification.lags + 2 + horizon, int(np.prod(batch, dtype=int))
    logs = [random_trajectory(seed, n_rows) for seed in range(size)]
    return [
        np.stack([getattr(log, name) for log in logs]).reshape(*batch, n_rows, 2) for name in ("q", "qd", "a")
    ]


def split(model, q, qd, a):
    """History, commands and measured configurations."""
    before = model.specification.lags + 2
    history = model.history_from_rows(*(rows[..., :before, :] for rows in (q, qd, a)))
    return history, a[..., before - 1 : -1, :], q[..., before:, :]


def test_gradient_in_every_parameter_is_that_of_central_differences(model, parameters):
    """Also in the history and the commands."""
    with jax.enable_x64(True):
        history, commands, q = split(model, *map(jnp.asarray, rows(model, horizon=6, batch=(3,))))
        flat, restore = ravel_pytree((parameters, history, commands))

        @jax.jit
        def loss(flat):
            parameters, history, commands = restore(flat)
            return open_loop_loss(model, parameters, history, commands, q, jnp.array([1.0, 0.25]))

        gradient = jax.grad(loss)(flat)
        losses = jax.jit(lambda step: jax.lax.map(lambda d: loss(flat + step * d), jnp.eye(len(flat))))
        differences = (losses(STEP) - losses(-STEP)) / (2 * STEP)
    assert np.abs(gradient).max() > 1e-2
    np.testing.assert_allclose(gradient, differences, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "lags", "horizon", "batch", "hidden"),
    [
        (("mlp", "dqdot"), 3, 8, (2, 2), [30, 4]),
        (("mlp", "dq"), 0, 1, (), [1]),
        (("mlp", "dq"), 4, 5, (3,), [4, 30]),
        (("kan", "dqdot"), 4, 3, (3,), [4, 1, 30]),
        (("kan", "dq"), 1, 6, (), [4]),
    ],
    ids=lambda value: "_".join(map(str, value)) if isinstance(value, list | tuple) else str(value),
)
def test_rollout_and_its_gradient_are_those_of_the_definition(kind, lags, horizon, batch, hidden):
    """Layers narrower and wider than their inputs; windows that end up all measured, mixed, all predicted."""
    model = DynamicsModel(make_specification(*kind, lags=lags, hidden=hidden))
    random = np.random.default_rng(1)
    weights = random.normal(size=(*batch, horizon, 2))
    shapes = jax.eval_shape(model.initialise, jax.random.key(0))
    parameters = jax.tree.map(lambda leaf: random.normal(0.0, 0.3, leaf.shape), shapes)

    @jax.jit
    def both(parameters, *rows):
        history, commands, _ = split(model, *rows)

        def value_and_gradients(predict):
            q, pull = jax.vjp(partial(predict, model), parameters, history, commands)
            return q, pull(weights)

        return value_and_gradients(rollout), value_and_gradients(Dynamics.roll_out)

    with jax.enable_x64(True):
        ours, defined = both(parameters, *rows(model, horizon, batch))
    assert jax.tree.structure(ours) == jax.tree.structure(defined)
    jax.tree.map(partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-10), ours, defined)
