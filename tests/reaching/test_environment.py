"""The Brax environment against single ticks, and its vectorised form against what the paper says of episodes."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env
from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper, EvalWrapper, VmapWrapper
from brax.training.agents.ppo.losses import compute_gae

from pipeline.configuration.load import ControlConfiguration, load_section
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.errors import InputError
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.fresh_episodes import FreshEpisodes, fresh_episodes
from pipeline.reaching.reward import RewardTerm
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import model_specification

BATCH = 8
DECISIONS = 5  # per episode of the fixture's 20 ticks
JUMP_RAD = 0.3
BOOM = jnp.array([0.0, 1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def first(environment):
    return jax.jit(jax.vmap(environment.reset))(jax.random.split(jax.random.PRNGKey(5), BATCH))


@pytest.fixture(scope="module")
def learning(environment):
    """The vectorised environment, its compiled reset and step."""
    wrapped = fresh_episodes(staggered=False)(environment, episode_length=20, action_repeat=4)
    return jax.jit(wrapped.reset), jax.jit(wrapped.step)


def actions(seed: int, n: int) -> jax.Array:
    return jax.random.uniform(jax.random.PRNGKey(seed), (n, BATCH, 4), minval=-1, maxval=1)


def test_is_a_brax_environment(environment, first):
    assert isinstance(environment, Env)
    assert first.obs.shape == (BATCH, environment.observation_size)
    assert environment.action_size == 4


def test_a_step_is_four_ticks_with_rewards_summed(environment, environment_step, first, task, tick):
    for action in actions(1, 3):
        state, rewards, terms = first.pipeline_state.task, 0.0, dict.fromkeys(RewardTerm, 0.0)
        previous = state.command
        command = np.where(np.abs(action) > 0.5, np.sign(action), 0.0)
        for repeat in range(4):
            state, outcome = tick(state, jnp.asarray(command, jnp.float32))
            rewards += outcome.reward
            for term in RewardTerm:
                terms[term] += getattr(outcome.terms, term)
            # only the first repeat changes the command
            change = -0.5 * np.abs(command - previous).mean(axis=-1) if repeat == 0 else np.zeros(BATCH)
            np.testing.assert_allclose(outcome.terms.action, change, atol=1e-6)
        stepped = environment_step(first, action)
        np.testing.assert_allclose(stepped.reward, rewards, atol=1e-4)
        for term in RewardTerm:
            np.testing.assert_allclose(stepped.metrics[f"reward_{term}"], terms[term], atol=1e-4)
        np.testing.assert_allclose(stepped.obs, task.observe(state), atol=1e-5)
        first = stepped


def test_an_episode_of_the_paper_is_125_decisions_of_four_ticks_at_20_hz(bobcat, paper_episodes):
    repeats = load_section("control", ControlConfiguration).action_repeats
    assert (bobcat.rate_hz, paper_episodes.steps, repeats) == (20.0, 500, 4)
    assert paper_episodes.steps / repeats == 125


def test_there_are_no_terminal_states(environment_step, first):
    state = first
    for action in actions(2, DECISIONS + 3):
        state = environment_step(state, action)
        assert not state.done.any()


def test_events_inside_repeats_count_once_per_episode(environment, environment_step, first):
    # the target is the start: reached in the first tick, left again under full command
    task_state = first.pipeline_state.task
    goal = task_state.goal._replace(configuration=task_state.history.q, pose=task_state.pose)
    at_goal = first.pipeline_state._replace(task=task_state._replace(goal=goal))
    state = first.replace(pipeline_state=at_goal)
    total = dict.fromkeys(("sr_002_002", "sr_004_004", "sr_012_008"), 0.0)
    for _ in range(DECISIONS):
        state = environment_step(state, jnp.ones((BATCH, 4)))
        for name in total:
            total[name] += state.metrics[name]
    for name, value in total.items():
        np.testing.assert_array_equal(value, np.ones(BATCH), err_msg=name)


class JumpingDynamics(DynamicsModel):
    """The boom goes down by `JUMP_RAD` in one tick and up again in the next, whatever is commanded."""

    def integrate(self, q, newest, residual):
        del residual
        velocity = jnp.where(newest < 0.0, 1.0, -1.0) * JUMP_RAD / self.specification.dt_s * BOOM
        return q + self.specification.dt_s * velocity, velocity


def test_leaving_the_workspace_inside_a_repeat_is_seen(bobcat, arm, paper_reward, poses, forward):
    dynamics = JumpingDynamics(model_specification(bobcat, Target.dqdot, lags=2))
    task = ReachingTask(bobcat, arm, dynamics, dynamics.initialise(jax.random.key(0)), paper_reward)
    environment = ReachingEnvironment(task, poses, action_repeats=4, episode_ticks=20)
    start = jnp.array([0.0, 0.8, -1.2, -1.0])
    assert (
        forward(start).position[2] > bobcat.workspace.z_min_m > forward(start - JUMP_RAD * BOOM).position[2]
    )
    first = environment.reset(jax.random.PRNGKey(0))
    begun = first.pipeline_state._replace(task=task.begin(start, start))
    state, step = first.replace(pipeline_state=begun), jax.jit(environment.step)
    for decision in range(2):
        state = step(state, jnp.zeros(4))
        np.testing.assert_allclose(state.pipeline_state.task.history.q, start, atol=1e-5)  # back again
        once = float(decision == 0)  # counted in the first decision of the episode that has it
        assert state.metrics["out_of_workspace"] == state.metrics["below_lower_plane"] == once
        np.testing.assert_allclose(state.metrics["reward_workspace"], 2 * -2.0)  # two of four ticks are below


def test_metric_keys_of_wrappers_survive(environment):
    """Brax's evaluation adds a key to `metrics` and expects it back; its sums are the paper's rates."""
    wrapped = EvalWrapper(FreshEpisodes(environment, staggered=False))
    state = jax.jit(wrapped.reset)(jax.random.split(jax.random.PRNGKey(0), BATCH))
    state = jax.jit(wrapped.step)(state, jnp.zeros((BATCH, 4)))
    assert "reward" in state.metrics
    sums = state.info["eval_metrics"].episode_metrics
    np.testing.assert_allclose(sums["reward"], state.reward)
    assert set(sums) >= {"sr_012_008", "out_of_workspace", "below_lower_plane", "reward_pose"}


def test_time_outs_are_truncations(learning):
    reset, step = learning
    state = reset(jax.random.split(jax.random.PRNGKey(0), BATCH))
    for decision, action in enumerate(actions(3, 2 * DECISIONS + 1), start=1):
        state = step(state, action)
        ends = decision % DECISIONS == 0
        np.testing.assert_array_equal(state.done, np.full(BATCH, float(ends)))
        np.testing.assert_array_equal(state.info["truncation"], state.done)
        assert (state.info["episode_metrics"]["length"] == 4 * ((decision - 1) % DECISIONS + 1)).all()


def test_brax_gives_truncated_steps_no_advantage_and_leaks_nothing_across():
    """What the environment relies on: in Brax's GAE a truncation cuts the sum, and V of the next episode is unused."""
    done, truncation = jnp.array([[0.0], [1.0], [0.0]]), jnp.array([[0.0], [1.0], [0.0]])
    termination = done * (1 - truncation)
    rewards, values = jnp.array([[1.0], [2.0], [3.0]]), jnp.array([[0.5], [0.6], [100.0]])
    targets, advantages = compute_gae(
        truncation, termination, rewards, values, jnp.array([7.0]), lambda_=0.95, discount=0.9
    )
    assert advantages[1, 0] == 0.0
    np.testing.assert_allclose(advantages[0, 0], 1.0 + 0.9 * 0.6 - 0.5, rtol=1e-6)
    np.testing.assert_allclose(targets[1, 0], 0.6, rtol=1e-6)


def test_every_episode_draws_start_and_target_anew_and_clears_its_history(learning):
    reset, step = learning
    n_episodes = 6
    state = reset(jax.random.split(jax.random.PRNGKey(1), BATCH))
    starts, goals = [], []
    for decision, action in enumerate(actions(4, n_episodes * DECISIONS)):
        if decision % DECISIONS == 0:
            task = state.pipeline_state.task
            starts.append(np.asarray(task.history.q))
            goals.append(np.asarray(task.goal.configuration))
            assert not np.any(task.history.motion) and not np.any(task.history.commands)
            assert not np.any(task.command)
            assert not np.any(state.pipeline_state.reached)
        state = step(state, action)
    for drawn in (np.concatenate(starts), np.concatenate(goals)):
        # 48 draws from 4096 rows: at most a repetition or two by chance
        assert len(np.unique(drawn, axis=0)) >= n_episodes * BATCH - 4
    # Brax's own wrappers, for contrast, see each environment's first target only: see the next test


def test_braxs_own_wrappers_would_replay_the_first_target(environment):
    wrapped = AutoResetWrapper(EpisodeWrapper(VmapWrapper(environment), episode_length=5, action_repeat=1))
    state = jax.jit(wrapped.reset)(jax.random.split(jax.random.PRNGKey(1), BATCH))
    step, goals = jax.jit(wrapped.step), []
    for action in actions(4, 3 * DECISIONS):
        goals.append(np.asarray(state.pipeline_state.task.goal.configuration))
        state = step(state, action)
    assert len(np.unique(np.concatenate(goals), axis=0)) == BATCH


def test_the_last_observation_of_an_episode_is_the_first_of_the_next(learning, task):
    reset, step = learning
    state = reset(jax.random.split(jax.random.PRNGKey(2), BATCH))
    for action in actions(5, DECISIONS):
        state = step(state, action)
    np.testing.assert_allclose(state.obs, task.observe(state.pipeline_state.task), atol=1e-6)


def test_staggered_episodes_time_out_evenly(environment):
    wrapped = FreshEpisodes(environment, staggered=True)
    state = jax.jit(wrapped.reset)(jax.random.split(jax.random.PRNGKey(0), 10))
    step, ended = jax.jit(wrapped.step), []
    for _ in range(2 * DECISIONS):
        state = step(state, jnp.zeros((10, 4)))
        ended.append(int(state.done.sum()))
    assert ended == [2] * (2 * DECISIONS)


def test_takes_the_arguments_that_brax_passes():
    wrap = fresh_episodes(staggered=False)
    assert any(p.kind is p.VAR_KEYWORD for p in inspect.signature(wrap).parameters.values())


def test_an_episode_is_a_whole_number_of_decisions(task, poses):
    with pytest.raises(InputError, match="501"):
        ReachingEnvironment(task, poses, action_repeats=4, episode_ticks=501)
