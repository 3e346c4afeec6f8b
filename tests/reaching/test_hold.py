"""A held command against single ticks: same states, same outcomes, for every kind of model."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Parameterization, Target
from tests.dynamics.conftest import move_biases
from tests.reaching.lag import model_specification, random_configurations

BATCH = 16
N_DECISIONS = 4


def commands(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(-1, 2, (N_DECISIONS, BATCH, 4)).astype(np.float32)


def model_of(bobcat, parameterization: str, target: str, lags: int) -> tuple[DynamicsModel, dict]:
    specification = dataclasses.replace(
        model_specification(bobcat, Target(target), lags), parameterization=Parameterization(parameterization)
    )
    model = DynamicsModel(specification)
    return model, jax.tree.map(jnp.float32, move_biases(model.initialise(jax.random.key(0))))


# Windows longer and shorter than a decision, whole numbers of decisions and not; one step per decision.
@pytest.mark.parametrize(
    ("parameterization", "target", "lags", "n_steps"),
    [
        ("mlp", "dqdot", 6, 4),
        ("mlp", "dq", 8, 4),
        ("kan", "dqdot", 2, 4),
        ("kan", "dq", 5, 3),
        ("mlp", "dqdot", 3, 1),
    ],
)
def test_holding_is_stepping(bobcat, parameterization, target, lags, n_steps):
    model, parameters = model_of(bobcat, parameterization, target, lags)
    start = random_configurations(bobcat, jax.random.key(1), BATCH)
    step = jax.jit(lambda history, command: model.step(parameters, history, command))
    held = jax.jit(lambda history, command: model.hold(parameters, history, command, n_steps))
    single = at_once = model.initial_history(start)
    for command in commands(2):
        visited = []
        for _ in range(n_steps):
            single = step(single, command)
            visited.append(single.q)
        at_once, q = held(at_once, command)
        np.testing.assert_allclose(q, np.stack(visited), rtol=0, atol=2e-6)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-5), at_once, single)


def test_the_task_held_is_the_task_ticked_end_stops_included(bobcat, arm, paper_reward, tick, task):
    start = random_configurations(bobcat, jax.random.key(3), BATCH)
    start = start.at[: BATCH // 2].set(
        jnp.asarray(bobcat.upper - 0.02, jnp.float32)
    )  # next to their end stops
    goal = start.at[:, 1].add(-0.01)  # some bonuses are earned
    hold_task = jax.jit(lambda state, command: task.hold(state, command, 4))
    single = at_once = jax.jit(task.begin)(start, goal)
    n_stopped = 0
    for command in commands(4) * np.where(np.arange(BATCH) < BATCH // 2, -1.0, 1.0)[:, None] ** 2:
        outcomes = []
        for _ in range(4):
            single, outcome = tick(single, command)
            outcomes.append(outcome)
        at_once, held = hold_task(at_once, command)
        n_stopped += int((at_once.history.q == jnp.asarray(bobcat.upper, jnp.float32)).sum())
        ticked = jax.tree.map(lambda *values: np.stack(values), *outcomes)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=2e-5), held, ticked)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-5), at_once, single)
    assert n_stopped > 0
