"""The task on a model with effects around it: the frozen model's steps at neutral, its effects and its stops else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.effect import Setting
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics, model_specification

N_TICKS = 12


@pytest.fixture(scope="module")
def augmented_task(bobcat, arm, paper_reward):
    """From a frozen model, its parameters and changed values to a task."""
    speed = np.full(bobcat.n_joint, 0.5)
    setting = Setting(bobcat.dt_s, np.asarray(bobcat.lower), np.asarray(bobcat.upper), speed)

    def build(frozen, parameters, changes):
        chain = Chain([KNOWN[family] for family in changes], setting)
        values = jax.tree.map(jnp.asarray, chain.neutral())
        for family, of in changes.items():
            for name, value in of.items():
                values[family][name] = jnp.full(bobcat.n_joint, value)
        return ReachingTask(
            bobcat, arm, AugmentedModel(frozen, chain), AugmentedParameters(parameters, values), paper_reward
        )

    return build


def rolled_out(task: ReachingTask, q: jax.Array, command: jax.Array):
    """Configurations and rewards, tick by tick."""

    def tick(state, _):
        state, outcome = task.tick(state, command)
        return state, (state.history.q, outcome.reward)

    return jax.jit(lambda q: jax.lax.scan(tick, task.begin(q, q), length=N_TICKS)[1])(q)


@pytest.fixture(scope="module")
def middle(bobcat) -> jax.Array:
    return jnp.asarray(0.5 * (np.asarray(bobcat.lower) + np.asarray(bobcat.upper)), jnp.float32)[None]


def test_neutral_effects_change_nothing(task: ReachingTask, augmented_task, middle):
    command = jnp.ones_like(middle)
    neutral = augmented_task(task.dynamics, task.parameters, {"gain": {}, "sensor_bias": {}})
    for expected, got in zip(
        rolled_out(task, middle, command), rolled_out(neutral, middle, command), strict=True
    ):
        np.testing.assert_allclose(got, expected, atol=1e-6)


def test_a_slower_machine_is_slower(task: ReachingTask, augmented_task, middle):
    half = {"gain": {"ratio_positive": 0.5, "ratio_negative": 0.5}}
    slower = augmented_task(task.dynamics, task.parameters, half)
    command = jnp.ones_like(middle)
    expected = 0.5 * (rolled_out(task, middle, command)[0] - middle)
    np.testing.assert_allclose(rolled_out(slower, middle, command)[0] - middle, expected, atol=1e-5)


def test_holding_a_command_is_ticking_with_it(augmented_task, bobcat, middle):
    faster = augmented_task(lag_dynamics(bobcat), {}, {"gain": {"ratio_positive": 1.3}})
    command = jnp.ones_like(middle)
    _, outcome = jax.jit(lambda q: faster.hold(faster.begin(q, q), command, N_TICKS))(middle)
    np.testing.assert_allclose(outcome.reward, rolled_out(faster, middle, command)[1], atol=1e-5)


@pytest.mark.parametrize("target", list(Target))
@pytest.mark.parametrize("offset", [0.0, 0.1])
def test_stops_are_where_they_are_whatever_encoders_read(augmented_task, bobcat, target, offset):
    frozen = DynamicsModel(model_specification(bobcat, target, lags=2))
    # zero weights: the residual is the output bias, a push of 0.02 per tick
    parameters = jax.tree.map(jnp.zeros_like, frozen.initialise(jax.random.key(0)))
    parameters["layer_1"]["bias"] = jnp.ones(bobcat.n_joint)
    task = augmented_task(frozen, parameters, {"sensor_bias": {"offset": offset}})
    upper = jnp.asarray(bobcat.upper, jnp.float32)
    read = (upper + offset)[None]  # of a machine that rests at its stop
    state, _ = jax.jit(lambda q: task.tick(task.begin(q, q), jnp.zeros_like(q)))(read)
    np.testing.assert_allclose(state.history.nominal.q[0], upper, atol=1e-6)
    np.testing.assert_allclose(state.history.q[0], upper + offset, atol=1e-6)
    at_rest = upper + offset if target is Target.dq else jnp.zeros(bobcat.n_joint)
    np.testing.assert_allclose(state.history.motion[0, -1], at_rest, atol=1e-6)
