"""The environment's first two steps against the paper's equations: what acts when, and what the policy sees."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Parameterization, Target
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.task import ReachingTask
from tests.dynamics import reference
from tests.dynamics.conftest import move_biases
from tests.reaching.lag import model_specification

LAGS = 3
COMMANDS = np.array([[1, 0, -1, 1], [-1, 1, 0, 1]])


@pytest.mark.parametrize(("parameterization", "target"), [("mlp", "dqdot"), ("kan", "dq")])
def test_steps_0_and_1_follow_the_paper(bobcat, arm, paper_reward, poses, parameterization, target):
    specification = dataclasses.replace(
        model_specification(bobcat, Target(target), LAGS), parameterization=Parameterization(parameterization)
    )
    model = DynamicsModel(specification)
    parameters = jax.tree.map(jnp.float32, move_biases(model.initialise(jax.random.key(0))))
    task = ReachingTask(bobcat, arm, model, parameters, paper_reward)
    environment = ReachingEnvironment(task, poses, action_repeats=1, episode_ticks=20)
    state = environment.reset(jax.random.key(5))
    start = np.asarray(state.pipeline_state.task.history.q, np.float64)

    # Rows of a machine at rest in the start configuration, then the commands: row t is the first that acts.
    t = LAGS + 1
    q, qd = np.tile(start, (t + 1, 1)), np.zeros((t + 1, 4))
    a = np.concatenate([np.zeros((t, 4)), COMMANDS])
    expected = reference.rollout(specification, parameters, q, qd, a, t, horizon=2)
    assert np.all((expected > bobcat.lower) & (expected < bobcat.upper))  # no end stop acts
    positions = np.concatenate([q, expected])
    velocities = np.concatenate([qd, np.diff(np.concatenate([q[-1:], expected]), axis=0) / 0.05])
    motion = positions if target == "dq" else velocities

    step = jax.jit(environment.step)
    for now in (t, t + 1, t + 2):
        x = reference.approximate_state(
            specification, motion[now - LAGS : now + 1], a[now - LAGS - 1 : now], positions[now]
        )
        np.testing.assert_allclose(state.obs[: len(x)], x, rtol=0, atol=2e-5)
        if now < t + 2:
            state = step(state, jnp.asarray(COMMANDS[now - t], jnp.float32))
            np.testing.assert_allclose(
                state.pipeline_state.task.history.q, positions[now + 1], rtol=0, atol=1e-6
            )
