"""Trials through the graph against the evaluation in Brax, and successive targets as a bag."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_machine, load_section
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import Policy, PolicyLayer
from pipeline.deployment.components.controllers import PolicyController
from pipeline.deployment.components.goals import compiled_forward, goal_solver, known_configurations
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.termination import TerminalConditions
from pipeline.deployment.drivers.machine import LearnedStep
from pipeline.deployment.messages import GoalOutcome
from pipeline.deployment.successive import run_successive
from pipeline.deployment.transports.simulated_time.delays import Distribution, no_delays
from pipeline.deployment.trials import GraphParts, run_episodes
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.trajectories import load_logs
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.logged_trials import logged_trials, trial_traces
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.deployment.machines import MIDDLE, Integrator, arm, bobcat, estimator, paper, supervised
from tests.reaching.lag import lag_dynamics

TICKS = 40
STARTS = np.array([MIDDLE, MIDDLE + np.array([0.3, 0.1, -0.1, 0.2])], np.float32)
TARGETS = np.array(
    [MIDDLE + np.array([0.2, -0.1, 0.2, 0.1]), MIDDLE - np.array([0.3, 0.1, 0.0, 0.2])], np.float32
)


@pytest.fixture(scope="module")
def parts() -> GraphParts:
    task = ReachingTask(bobcat(), arm(), lag_dynamics(bobcat()), {}, load_section("reward", RewardConfig))
    layer = 2.0 * jax.random.normal(jax.random.key(0), (task.observation_size, 8)) / np.sqrt(100.0)
    ones = jnp.ones(task.observation_size)
    policy = Policy(0 * ones, ones, (PolicyLayer(layer, jnp.zeros(8)),))
    return GraphParts(
        task,
        PolicyController(task, policy),
        goal_solver(bobcat(), arm()),
        TerminalConditions(bobcat(), arm(), paper().termination),
        paper(),
        action_repeats=4,
        maximum_ticks=TICKS,
        step=LearnedStep(task),
    )


@pytest.fixture(scope="module")
def episodes() -> Episodes:
    return Episodes(STARTS, TARGETS)


def test_a_graph_without_delays_is_brax(parts: GraphParts, episodes: Episodes) -> None:
    """Tick for tick, but for the ticks at rest until the first decision."""
    policy = parts.controller._policy
    brax = evaluate_policy(policy, parts.task, 4, TICKS, episodes)
    traces = trial_traces(run_episodes(parts, no_delays(), episodes), bobcat(), arm())
    assert traces.command.any()
    for n in range(len(STARTS)):
        waited = int(np.argmax(traces.command[n].any(axis=1)) - np.argmax(brax.command[n].any(axis=1)))
        assert 0 <= waited <= 2
        np.testing.assert_array_equal(traces.command[n, waited:], brax.command[n, : TICKS - waited])
        np.testing.assert_allclose(traces.q[n, waited:], brax.q[n, : TICKS - waited], atol=2e-6)


def test_a_graph_has_the_supervisor_that_its_settings_ask_for(parts: GraphParts, episodes: Episodes) -> None:
    config = dataclasses.replace(
        supervised(), supervisor=dataclasses.replace(paper().supervisor, rules=["joint_limits"])
    )
    supervisor = partial(supervise, bobcat(), config, MACHINE_DIRECTORY)
    watched = dataclasses.replace(parts, config=config, new_supervisor=supervisor)
    traces = trial_traces(run_episodes(watched, no_delays(), episodes), bobcat(), arm())
    assert traces.command.any()  # which the interface would mute without a sign of life


def test_delays_change_the_trial_and_the_seed_repeats_it(parts: GraphParts, episodes: Episodes) -> None:
    late = {**no_delays(), "command": Distribution(np.array([0.01, 0.06]), 0.0)}
    first, again = (trial_traces(run_episodes(parts, late, episodes), bobcat(), arm()) for _ in range(2))
    np.testing.assert_array_equal(first.q, again.q)
    sound = trial_traces(run_episodes(parts, no_delays(), episodes), bobcat(), arm())
    assert not np.array_equal(first.q, sound.q)
    alone = trial_traces(run_episodes(parts, late, episodes.first(1)), bobcat(), arm())
    np.testing.assert_array_equal(alone.q[0], first.q[0])


def test_poses_find_their_configurations(parts: GraphParts, episodes: Episodes) -> None:
    pose = compiled_forward(arm())(TARGETS[0])
    position, quaternion = np.asarray(pose.position), np.asarray(pose.quaternion)
    known = known_configurations(arm(), episodes.targets)
    np.testing.assert_array_equal(known(position, quaternion, MIDDLE), TARGETS[0])
    np.testing.assert_allclose(parts.solve_goal(position, quaternion, MIDDLE), TARGETS[0], atol=1e-4)
    for solve in (known, parts.solve_goal):
        assert solve(np.array([9.0, 0.0, 0.0]), quaternion, MIDDLE) is None
    assert parts.solve_goal(np.full(3, np.nan), quaternion, MIDDLE) is None


def test_successive_targets_are_a_bag_that_is_read_as_any_log(parts, episodes, tmp_path) -> None:
    parts = parts.with_goals(known_configurations(arm(), episodes.targets))
    targets = np.concatenate([TARGETS, TARGETS[:1]])
    begin_ns = 1_775_000_000_000_000_000
    recorder = run_successive(parts, no_delays(), Integrator(), estimator(), targets, begin_ns)
    assert [result.outcome for result in recorder.results] == [GoalOutcome.timed_out] * 3
    recorder.write(tmp_path / "logs/deployment", bobcat())
    control = load_section("control", ControlConfiguration)
    ingest = dataclasses.replace(load_section("ingest", IngestConfig), minimum_trajectory_s=0.5)
    (log,) = load_logs(tmp_path / "logs", load_machine("bobcat_e10"), ingest, control.loop_tracker)
    trials = logged_trials(log.trajectories, log.targets, TICKS)
    assert len(trials) == 3 and min(trial.n_ticks for trial in trials) >= TICKS - 2
    np.testing.assert_allclose(trials[1].position, compiled_forward(arm())(TARGETS[1]).position, atol=1e-6)
