"""A new kind of model is one class: environment, planner, graph and predictor take it, and it equals the network."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.control.icem.controller import icem_planner
from pipeline.control.icem.returns import sequence_returns
from pipeline.deployment.components.controllers import ControllerState, IcemController
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep
from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.features import History, approximate_state, push
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.specification import Target
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.task import ReachingTask
from tests.dynamics.conftest import random_trajectory
from tests.reaching.lag import (
    DEAD_TICKS,
    FULL_SPEED,
    TIME_CONSTANT_S,
    lag_dynamics,
    model_specification,
    random_configurations,
)


class LinearLag(Dynamics[dict, History]):
    """v += dt/tau (speed a_{t-dead} - v), q += dt v, of parameters `tau_s` and `speed`: no network."""

    has_hidden_state = False

    def __init__(self, machine) -> None:
        self.specification = model_specification(machine, Target.dqdot, lags=6)

    def initial_history(self, q):
        still = jnp.zeros((*q.shape[:-1], self.specification.lags + 1, q.shape[-1]))
        return History(still, still, q)

    def features(self, history):
        return approximate_state(history.motion, history.commands, self.normalise_position(history.q))

    def step(self, parameters, history, command, stops=None):
        commands, dt_s = push(history.commands, command), self.specification.dt_s
        v, acting = history.motion[..., -1, :], commands[..., -1 - DEAD_TICKS, :]
        v = v + dt_s / parameters["tau_s"] * (parameters["speed"] * acting - v)
        q = history.q + dt_s * v
        if stops is not None:
            q, v = stops.act(self.specification.target, q, v)
        return History(push(history.motion, v), commands, q)


@pytest.fixture(scope="module")
def parameters():
    return {"tau_s": TIME_CONSTANT_S, "speed": FULL_SPEED}


@pytest.fixture(scope="module")
def tasks(bobcat, arm, paper_reward, parameters):
    """On the new kind, and on the network that is written down to be equal."""
    new = ReachingTask(bobcat, arm, LinearLag(bobcat), parameters, paper_reward)
    return new, ReachingTask(bobcat, arm, lag_dynamics(bobcat), {}, paper_reward)


def assert_equal(got, expected, atol):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=atol), got, expected)


def test_the_environment_steps_it(tasks, poses):
    def run(task):
        environment = ReachingEnvironment(task, poses, action_repeats=4, episode_ticks=20)
        state = jax.jit(jax.vmap(environment.reset))(jax.random.split(jax.random.PRNGKey(0), 5))
        step = jax.jit(environment.step)
        for action in jax.random.uniform(jax.random.key(1), (4, 5, 4), minval=-1.0):
            state = step(state, action)
        return state.obs, state.reward

    new, network = map(run, tasks)
    assert_equal(new, network, atol=1e-4)


@pytest.mark.long
def test_the_planner_plans_on_it(tasks, bobcat, small_icem):
    start, goal = random_configurations(bobcat, jax.random.key(2), 2)
    commands = jnp.sign(jax.random.normal(jax.random.key(3), (6, 5, 4)))

    def run(task):
        state = jax.jit(task.begin)(start, goal)
        planner = icem_planner(task, small_icem, action_repeats=4)
        _, command = jax.jit(planner.decide)(planner.begin(jax.random.key(4)), state)
        return jax.jit(sequence_returns(task, 4, 0.9))(state, commands), command

    new, network = map(run, tasks)
    assert np.ptp(new[0]) > 0.1
    assert_equal(new, network, atol=1e-3)


@pytest.mark.long
def test_the_graph_drives_it_and_decides_on_it(tasks, bobcat, small_icem):
    start = (np.asarray(bobcat.lower + bobcat.upper) / 2).astype(np.float32)

    def run(task):
        machine = LearnedMachine(LearnedStep(task), start)
        (sample,) = [machine.advance(np.ones(4)) for _ in range(6)][-1]
        history = jax.device_get(task.dynamics.initial_history(jnp.asarray(start)))
        planner = IcemController(task, small_icem, action_repeats=4, seed=0)
        return sample, planner.decide(ControllerState(history.motion, history.commands, start, start + 0.2))

    new, network = map(run, tasks)
    assert new[0].position[0] > start[0]
    assert_equal(new, network, atol=1e-5)


def test_it_predicts_logs(tasks, parameters):
    log, starts = random_trajectory(1, n_rows=40, n_joint=4), np.array([10, 12])
    new, network = (
        LearnedPredictor(task.dynamics, task.parameters).predict(log, starts, 20) for task in tasks
    )
    np.testing.assert_allclose(new, network, rtol=0, atol=1e-5)
