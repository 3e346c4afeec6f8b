"""Traces against the task, stepped tick by tick with a policy that can be checked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import Policy, PolicyLayer
from pipeline.machine.chain import GROUND
from pipeline.reaching.metrics import reaching_metrics


def towards_the_target(n_observation: int) -> Policy:
    """tanh(10 (q_target - q)) per joint, on normalised configurations, the observation's last eight numbers."""
    kernel = jnp.zeros((n_observation, 8))
    for joint in range(4):
        kernel = kernel.at[n_observation - 8 + joint, joint].set(-10.0)
        kernel = kernel.at[n_observation - 4 + joint, joint].set(10.0)
    return Policy(jnp.zeros(n_observation), jnp.ones(n_observation), (PolicyLayer(kernel, jnp.zeros(8)),))


@pytest.fixture(scope="module")
def policy(environment) -> Policy:
    return towards_the_target(environment.observation_size)


@pytest.fixture(scope="module")
def traces(policy, environment, episodes):
    return evaluate_policy(
        policy, environment.task, environment.action_repeats, environment.episode_ticks, episodes
    )


def test_traces_equal_the_task_stepped_by_hand(policy, traces, environment, episodes, task):
    tick, observe = jax.jit(task.tick), jax.jit(task.observe)
    state = jax.jit(task.begin)(jnp.asarray(episodes.starts), jnp.asarray(episodes.targets))
    np.testing.assert_allclose(traces.start_position, state.pose.position, atol=1e-6)
    for index in range(environment.episode_ticks):
        if index % 4 == 0:  # a decision holds for four ticks
            proto = np.asarray(policy.act(observe(state)))
            command = np.where(np.abs(proto) > 0.5, np.sign(proto), 0.0).astype(np.float32)
        state, outcome = tick(state, jnp.asarray(command))
        np.testing.assert_array_equal(traces.command[:, index], command)
        np.testing.assert_allclose(traces.q[:, index], state.history.q, atol=1e-5)
        np.testing.assert_allclose(traces.position[:, index], state.pose.position, atol=1e-5)
        np.testing.assert_allclose(traces.position_error[:, index], outcome.deviation.position, atol=1e-5)
        np.testing.assert_allclose(traces.pitch_error[:, index], outcome.deviation.pitch, atol=1e-5)
        np.testing.assert_array_equal(traces.inside[:, index], outcome.inside)
        np.testing.assert_array_equal(traces.below[:, index], outcome.below)
        np.testing.assert_allclose(traces.reward[:, index], outcome.reward, atol=1e-4)


def test_a_policy_that_heads_for_the_target_comes_nearer(traces):
    assert traces.position_error[:, -1].mean() < 0.7 * traces.position_error[:, 0].mean()


def test_metrics_of_traces_are_finite_and_count_every_episode(traces):
    metrics = reaching_metrics(traces, GROUND)
    assert metrics.n_episodes == 16
    assert all(np.isfinite(value) for value in metrics.as_dict().values())
    assert metrics.ooz <= metrics.oow
