"""The task against its parts: dynamics, kinematics, workspace and reward, one state at a time."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.errors import InputError
from pipeline.machine.specification import CommandKind, MachineSpecification
from pipeline.reaching.reward import RewardTerm
from pipeline.reaching.task import ReachingTask
from tests.reaching import reference
from tests.reaching.lag import DEAD_TICKS, lag_dynamics, model_specification, random_configurations

BATCH = 64


@pytest.fixture(scope="module")
def rollout(task: ReachingTask, tick, bobcat: MachineSpecification):
    """Twelve ticks under random commands, away from joint limits: states (with the first), commands, outcomes."""
    start_key, goal_key, command_key = jax.random.split(jax.random.key(3), 3)
    middle = jnp.asarray(bobcat.lower + bobcat.upper, jnp.float32) / 2
    starts = middle + 0.7 * (random_configurations(bobcat, start_key, BATCH) - middle)
    goals = starts + 0.1 * jax.random.normal(goal_key, starts.shape)
    commands = jax.random.randint(command_key, (12, *starts.shape), -1, 2).astype(jnp.float32)
    states, outcomes = [jax.jit(task.begin)(starts, goals)], []
    for command in commands:
        state, outcome = tick(states[-1], command)
        states.append(state)
        outcomes.append(outcome)
    return states, commands, outcomes


def inside_workspace(machine: MachineSpecification, position: np.ndarray, yaw: float) -> bool:
    w = machine.workspace
    radius = np.hypot(position[0], position[1])
    in_front = position[0] * np.cos(yaw) + position[1] * np.sin(yaw) > 0
    return bool(
        w.radius_min_m <= radius <= w.radius_max_m
        and abs(yaw) <= w.yaw_max_rad
        and in_front
        and w.z_min_m <= position[2] <= w.z_max_m
    )


def test_rewards_along_a_rollout_equal_the_reference(rollout, bobcat):
    states, commands, outcomes = rollout
    n_compared = 0
    for index, outcome in enumerate(outcomes):
        state = states[index + 1]
        for b in range(BATCH):
            q, goal = np.asarray(state.history.q[b], float), np.asarray(state.goal.configuration[b], float)
            single = {
                "q": q,
                "q_target": goal,
                "p": np.asarray(state.pose.position[b], float),
                "p_target": np.asarray(state.goal.pose.position[b], float),
                "yaw": q[0],
                "pitch": q[1:].sum() + np.pi / 2,
                "yaw_target": goal[0],
                "pitch_target": goal[1:].sum() + np.pi / 2,
                "a": np.asarray(commands[index, b], float),
                "a_previous": np.zeros(4) if index == 0 else np.asarray(commands[index - 1, b], float),
            }
            single["r"] = reference.orientation(single["yaw"], single["pitch"])
            single["r_target"] = reference.orientation(single["yaw_target"], single["pitch_target"])
            single["inside"] = inside_workspace(bobcat, single["p"], single["yaw"])
            if reference.near_a_threshold(single):
                continue
            expected = reference.reward(single)
            for term in RewardTerm:
                np.testing.assert_allclose(getattr(outcome.terms, term)[b], expected[term], atol=1e-5)
            np.testing.assert_allclose(outcome.reward[b], sum(expected.values()), atol=2e-5)
            n_compared += 1
    assert n_compared > 0.95 * BATCH * len(outcomes)


def test_pose_and_flags_belong_to_the_configuration_reached(rollout, bobcat, forward):
    states, _, outcomes = rollout
    state, outcome = states[-1], outcomes[-1]
    np.testing.assert_allclose(state.pose.position, forward(state.history.q).position, atol=1e-6)
    z = np.asarray(state.pose.position[:, 2])
    np.testing.assert_array_equal(outcome.below, z < bobcat.workspace.z_min_m)
    assert not np.any(np.asarray(outcome.below & outcome.inside))


def test_commands_act_after_the_dead_time(task: ReachingTask, tick):
    start = jnp.tile(jnp.array([0.0, 0.3, -1.0, -1.0]), (BATCH, 1))
    state = jax.jit(task.begin)(start, start)
    for index in range(DEAD_TICKS + 1):
        np.testing.assert_array_equal(state.history.q, start, err_msg=f"tick {index}")
        state, _ = tick(state, jnp.ones((BATCH, 4)))
    assert (state.history.q > start).all()


def test_joint_limits_are_end_stops(bobcat, arm, paper_reward):
    for target in Target:
        dynamics = DynamicsModel(model_specification(bobcat, target, lags=2))
        # zero weights: the residual is the output bias, a push of 0.02 per tick
        parameters = jax.tree.map(jnp.zeros_like, dynamics.initialise(jax.random.key(0)))
        parameters["layer_1"]["bias"] = jnp.ones(4)
        task = ReachingTask(bobcat, arm, dynamics, parameters, paper_reward)
        upper = jnp.asarray(bobcat.upper, jnp.float32)
        begin_and_tick = jax.jit(lambda q, task=task: task.tick(task.begin(q, q), jnp.zeros_like(q)))
        state, _ = begin_and_tick(upper[None])
        np.testing.assert_array_equal(state.history.q[0], upper)
        at_rest = upper if target is Target.dq else jnp.zeros(4)
        np.testing.assert_array_equal(state.history.motion[0, -1], at_rest)


def test_observation_lists_what_the_paper_lists(task: ReachingTask, rollout, bobcat, forward):
    states, commands, _ = rollout
    state = states[-1]
    observation = np.asarray(jax.jit(task.observe)(state))
    lags = task.dynamics.specification.lags
    n_window = 4 * (lags + 1)
    assert observation.shape == (BATCH, 2 * n_window + 4 + 14 + 8) == (BATCH, task.observation_size)
    # velocities are normalised by ±1 rad/s, so x̃ begins with the velocities themselves, oldest first
    q = np.stack([np.asarray(s.history.q) for s in states[-lags - 2 :]], axis=1)
    velocities = np.diff(q, axis=1) * bobcat.rate_hz
    np.testing.assert_allclose(observation[:, :n_window], velocities.reshape(BATCH, -1), atol=1e-4)
    recent = np.moveaxis(np.asarray(commands[-lags - 1 :]), 0, 1)
    np.testing.assert_array_equal(observation[:, n_window : 2 * n_window], recent.reshape(BATCH, -1))
    middle = (bobcat.upper + bobcat.lower) / 2
    half = (bobcat.upper - bobcat.lower) / 2
    current = (np.asarray(state.history.q) - middle) / half
    goal = (np.asarray(state.goal.configuration) - middle) / half
    rest = observation[:, 2 * n_window :]
    np.testing.assert_allclose(rest[:, :4], current, atol=1e-5)
    for start, configuration in ((4, state.history.q), (11, state.goal.configuration)):
        pose = forward(configuration)
        np.testing.assert_allclose(rest[:, start : start + 3], pose.position, atol=1e-5)
        np.testing.assert_allclose(rest[:, start + 3 : start + 7], pose.quaternion, atol=1e-5)
    np.testing.assert_allclose(rest[:, 18:22], current, atol=1e-5)
    np.testing.assert_allclose(rest[:, 22:26], goal, atol=1e-5)


def test_continuous_machines_take_proto_actions_undiscretised(bobcat, arm, paper_reward):
    proto = jnp.array([[0.3, -0.7, 0.5, 2.0]])
    continuous = dataclasses.replace(bobcat, command_kind=CommandKind.continuous)
    task = ReachingTask(continuous, arm, lag_dynamics(continuous), {}, paper_reward)
    np.testing.assert_allclose(task.command(proto), [[0.3, -0.7, 0.5, 1.0]])


def test_a_model_of_another_machine_is_refused(bobcat, arm, paper_reward):
    dynamics = lag_dynamics(bobcat)
    dynamics.specification.joints = ["swing", "boom", "stick", "bucket"]
    with pytest.raises(InputError, match="stick"):
        ReachingTask(bobcat, arm, dynamics, {}, paper_reward)
    dynamics = lag_dynamics(bobcat)
    dynamics.specification.position_upper = [2.1, 0.12, 0.14, 0.108]  # of joints of the same names
    with pytest.raises(InputError, match=r"bucket \[-2.2, 0.108\] at 20 Hz, machine bobcat_e10 has swing"):
        ReachingTask(bobcat, arm, dynamics, {}, paper_reward)
