"""The augmented model, step by step, against hand numbers and against the predictor on the rows that it made."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.effects.augmented_model import WARM_S, AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import DT_S, SETTING, VALUES, make_model, make_trajectory
from .linear_machine import FULL_SPEED, commands, linear_model

KINDS = [("kan", "dq"), ("mlp", "dqdot")]
TARGETS = ["dq", "dqdot"]
NAMES = ["delay", "stiction", "gain", "load", "thermal_drift", "end_cushion", "lag", "leakage", "sensor_bias"]


def rolled_out(model, parameters, q, a):
    """Measured positions and the newest rows of `motion`, of the start and of every step."""

    def advance(history, command):
        history = model.step(parameters, history, command)
        return history, (history.q, history.motion[..., -1, :])

    history = model.initial_history(q)
    _, (positions, newest) = jax.jit(lambda a: jax.lax.scan(advance, history, a))(jnp.asarray(a, jnp.float32))
    return np.concatenate([history.q[None], positions]), np.concatenate([history.motion[-1][None], newest])


@pytest.mark.parametrize("target", TARGETS)
def test_a_gain_of_one_half_gives_half_the_way(target):
    frozen, theta = linear_model(target)
    chain = Chain([KNOWN["gain"]], SETTING)
    half = {"gain": {"ratio_positive": jnp.full(2, 0.5), "ratio_negative": jnp.full(2, 0.5)}}
    neutral = jax.tree.map(jnp.asarray, chain.neutral())
    q, a = jnp.array([-0.2, 0.2]), np.concatenate([np.ones((8, 2)), np.zeros((3, 2)), -np.ones((4, 2))])
    model = AugmentedModel(frozen, chain)
    slower, _ = rolled_out(model, AugmentedParameters(theta, half), q, a)
    as_before, _ = rolled_out(model, AugmentedParameters(theta, neutral), q, a)
    assert np.abs(as_before - q).max() > 0.05
    np.testing.assert_allclose(slower - q, 0.5 * (as_before - q), atol=1e-6)


@pytest.mark.parametrize("target", TARGETS)
def test_measured_and_true_positions_differ_by_the_sensor(target):
    frozen, theta = linear_model(target, share=1.0)  # no memory: u = c a
    chain = Chain([KNOWN["sensor_bias"]], SETTING)
    values = {"sensor_bias": {"offset": jnp.array([0.1, 0.0]), "scale": jnp.array([1.2, 0.9])}}
    model = AugmentedModel(frozen, chain)
    q, newest = rolled_out(model, AugmentedParameters(theta, values), jnp.array([-0.2, 0.2]), np.ones((5, 2)))
    np.testing.assert_allclose(
        np.diff(q[1:], axis=0), np.tile([1.2, 0.9] * FULL_SPEED * DT_S, (4, 1)), atol=1e-6
    )
    velocity = np.tile([1.2, 0.9] * FULL_SPEED, (4, 1))
    np.testing.assert_allclose(newest[2:], q[2:] if target == "dq" else velocity, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS, ids="_".join)
def test_the_predictor_continues_rows_that_the_model_made(kind):
    """The predictor recovers states and nominal window from the rows: going on from any of them gives the rest."""
    frozen = make_model(*kind)
    theta = frozen.initialise(jax.random.key(1))
    values = {name: VALUES[name] for name in NAMES}
    chain = Chain([KNOWN[name] for name in NAMES], SETTING)
    parameters = AugmentedParameters(
        theta, jax.tree.map(lambda value: jnp.asarray(value, jnp.float32), values)
    )
    a = commands(3, 60)
    model = AugmentedModel(frozen, chain)
    history = model.initial_history(jnp.array([-0.1, 0.2]))
    true = chain.true(parameters.effects, history.q)
    nominal = frozen.initial_history(true)

    def advance(history, command):
        history = model.step(parameters, history, command)
        return history, (history.q, history.motion[..., -1, :])

    _, (q, newest) = jax.jit(lambda history, a: jax.lax.scan(advance, history, a))(
        history._replace(nominal=nominal), jnp.asarray(a, jnp.float32)
    )
    q = np.concatenate([history.q[None], q])
    is_dq = frozen.specification.target is Target.dq
    qd = np.gradient(q, DT_S, axis=0) if is_dq else np.concatenate([np.zeros((1, 2)), newest])
    log = make_trajectory(q, qd, np.concatenate([a, np.zeros((1, 2))]), start_s=WARM_S)
    starts = np.array([20, 27, 34])  # by then the first row, at rest in spite of the leakage, is forgotten
    predicted = AugmentedPredictor(frozen, theta, chain, values).predict(log, starts, 25)
    expected = q[starts[:, None] + 1 + np.arange(25)]
    assert np.abs(expected - q[starts][:, None]).max() > 0.01
    np.testing.assert_allclose(predicted, expected, atol=1e-4)
