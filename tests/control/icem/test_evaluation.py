"""iCEM through episodes: it reaches, chunk by chunk the same, and goes on after a kill."""

import dataclasses

import jax
import numpy as np
import pytest

from pipeline.control.chunks import episode_keys, evaluate_in_chunks
from pipeline.control.evaluate import EvaluatedEpisodes, controller_evaluation
from pipeline.control.icem.controller import icem_controller
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.errors import InputError
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces
from pipeline.reaching.reward import RewardTerms, total_reward
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics

pytestmark = pytest.mark.slow

TICKS = 48


@pytest.fixture(scope="module")
def evaluated(bobcat, arm, paper_reward, small_icem, episodes):
    reward = variant_reward(paper_reward, RewardVariant.icem_double_dagger)
    planned = ReachingTask(bobcat, arm, lag_dynamics(bobcat), {}, reward)
    config = dataclasses.replace(small_icem, horizon=4, iterations=2)
    run = controller_evaluation(icem_controller(planned, config, 4), planned, 4, TICKS)
    few = episodes.first(6)
    return few, run(None, few, episode_keys(0, 6)), run(None, few, episode_keys(0, 6))


def test_it_heads_for_the_target(evaluated):
    episodes, (traces, _), _ = evaluated
    before = np.linalg.norm(episodes.starts - episodes.targets, axis=-1)
    after = np.linalg.norm(traces.q[:, -1] - episodes.targets, axis=-1)
    assert np.all(after < before) and after.mean() < 0.4 * before.mean()


def test_commands_are_discrete_and_held(evaluated):
    command = evaluated[1].traces.command
    assert set(np.unique(command)) <= {-1.0, 0.0, 1.0}
    held = command.reshape(6, TICKS // 4, 4, 4)
    np.testing.assert_array_equal(held, np.broadcast_to(held[:, :, :1], held.shape))


def test_the_return_is_of_the_planners_own_reward(evaluated, paper_reward):
    _, (traces, terms), _ = evaluated
    np.testing.assert_allclose(traces.reward, terms.configuration + terms.action + terms.workspace, atol=1e-5)
    full = np.asarray(total_reward(paper_reward, terms))
    np.testing.assert_allclose(full - traces.reward, terms.precision + terms.pose, atol=1e-5)


def test_equal_keys_give_equal_episodes(evaluated):
    for a, b in zip(jax.tree.leaves(evaluated[1]), jax.tree.leaves(evaluated[2]), strict=True):
        np.testing.assert_array_equal(a, b)


class Counting:
    """Stands for an evaluation: traces that tell episode and key apart, and a count of the calls."""

    def __init__(self, stop_after: int = 100) -> None:
        self.calls, self._stop_after = 0, stop_after

    def __call__(self, episodes: Episodes, keys: jax.Array) -> EvaluatedEpisodes:
        if self.calls == self._stop_after:
            raise KeyboardInterrupt
        self.calls += 1
        content = episodes.starts[:, :1] + 1e-3 * np.asarray(jax.vmap(jax.random.uniform)(keys))[:, None]
        return EvaluatedEpisodes(Traces(*[content] * len(Traces._fields)), RewardTerms(*[content] * 5))


STARTS = Episodes(np.arange(7.0)[:, None], np.zeros((7, 1)))


def chunked(evaluate, chunk, directory=None, evaluation="a"):
    done = []
    result = evaluate_in_chunks(evaluate, STARTS, 3, chunk, directory, evaluation, done.append)
    assert sum(done) == 7
    return result


@pytest.mark.parametrize("chunk", [3, 10])
def test_chunks_change_nothing(chunk):
    expected = STARTS.starts + 1e-3 * np.asarray(jax.vmap(jax.random.uniform)(episode_keys(3, 7)))[:, None]
    result = chunked(Counting(), chunk)
    np.testing.assert_array_equal(result.traces.q, expected)
    np.testing.assert_array_equal(result.terms.pose, expected)


def test_a_killed_evaluation_goes_on_with_the_chunk_that_it_was_killed_in(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        chunked(Counting(stop_after=2), 3, tmp_path)
    resumed = Counting()
    result = chunked(resumed, 3, tmp_path)
    assert resumed.calls == 1
    np.testing.assert_array_equal(result.traces.q, chunked(Counting(), 3).traces.q)


def test_chunks_of_another_evaluation_are_not_taken_up(tmp_path):
    chunked(Counting(), 3, tmp_path)
    other = Counting()
    chunked(other, 3, tmp_path, evaluation="b")
    assert other.calls == 3


def test_a_damaged_chunk_is_named(tmp_path):
    chunked(Counting(), 7, tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match="episodes_000000_7"):
        chunked(Counting(), 7, tmp_path)


def test_an_episode_must_be_whole_decisions(task, small_icem):
    with pytest.raises(InputError, match=r"episodes\.steps 10"):
        controller_evaluation(icem_controller(task, small_icem, 4), task, 4, 10)
