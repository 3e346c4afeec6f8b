"""Training end to end on a small scale: the curve, the kept policy, checkpoints; and that it learns at all."""

import csv
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.control import ppo
from pipeline.control.checkpoint import load_checkpoint
from pipeline.control.curve import write_curve
from pipeline.control.ppo import LinearDecay, PPOConfig, train
from pipeline.errors import InputError

POINT = 40 * 5120  # steps between two points of the curve


@pytest.fixture(scope="module")
def trained(environment, small, episodes, tmp_path_factory):
    directory = tmp_path_factory.mktemp("checkpoints")
    points = []
    return train(environment, small, 7, episodes, points.append, directory), points, directory


def test_curve_has_the_asked_points_and_the_kept_policy_is_of_one(trained):
    result, points, _ = trained
    # 128 sequences x 10 decisions x 4 ticks = 5120 steps a batch, 40 batches a point
    assert [point.steps for point in result.curve] == [0, POINT, 2 * POINT]
    assert points == result.curve
    assert result.policy_steps == POINT
    assert all(point.metrics.n_episodes == 16 for point in result.curve)


def test_a_finished_training_is_not_repeated(trained, environment, small, episodes, monkeypatch):
    monkeypatch.setattr(ppo.ppo, "train", None)  # would fail if it were called
    points = []
    again = train(environment, small, 7, episodes, points.append, trained[2])
    assert points == []
    assert again.curve == trained[0].curve
    jax.tree.map(np.testing.assert_array_equal, again.policy, trained[0].policy)


class Killed(Exception):
    pass


def test_an_interrupted_training_goes_on_from_its_checkpoint(
    trained, environment, small, episodes, tmp_path, monkeypatch
):
    def kill(point):
        if point.steps == POINT:
            raise Killed

    with pytest.raises(Killed):
        train(environment, small, 7, episodes, kill, tmp_path)

    handed_over = {}
    brax_train = ppo.ppo.train

    def spy(**arguments):
        handed_over.update(arguments)
        return brax_train(**arguments)

    monkeypatch.setattr(ppo.ppo, "train", spy)
    points = []
    result = train(environment, small, 7, episodes, points.append, tmp_path)
    assert [point.steps for point in points] == [2 * POINT]
    # the same seed gives the same training, up to where it was killed
    assert result.curve[:2] == trained[0].curve[:2]
    jax.tree.map(np.testing.assert_array_equal, result.policy, trained[0].policy)  # kept before the kill
    assert handed_over["num_timesteps"] == POINT
    assert handed_over["seed"] != 7  # else it would draw the same random numbers once more
    # half of the updates are done
    np.testing.assert_allclose(handed_over["learning_rate"](0), (3e-3 + 3e-4) / 2, rtol=1e-5)
    statistics = handed_over["restore_params"][0]
    assert int(statistics.count.lo) == POINT // 4  # observations, one per decision


def test_a_checkpoint_of_another_training_is_not_taken(trained, environment, small, episodes):
    other = ppo._identity(environment, dataclasses.replace(small, discount=0.9), 7, episodes)
    assert load_checkpoint(trained[2], other, ppo._untrained(environment, small)) is None


def test_learns_to_approach_the_target(trained):
    untrained, _, learned = (point.metrics.average_return for point in trained[0].curve)
    assert learned > 0.9 * untrained  # returns are negative: at least a tenth better


def test_linear_decay_is_a_schedule_and_an_array():
    decay = LinearDecay(1e-3, 1e-4, n_updates=100, n_updates_before=20)
    np.testing.assert_allclose(decay(0), 1e-3 - 0.2 * 9e-4, rtol=1e-6)
    np.testing.assert_allclose(decay(80), 1e-4, rtol=1e-5)
    np.testing.assert_allclose(decay(500), 1e-4, rtol=1e-5)
    np.testing.assert_allclose(jnp.array(decay), 1e-3)


def test_curve_file_is_tidy(trained, tmp_path):
    write_curve(tmp_path / "curves.csv", trained[0].curve)
    with (tmp_path / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["steps"]) for row in rows] == [0, POINT, 2 * POINT]
    assert {"average_return", "sr_012_008", "oow"} <= set(rows[0])


@pytest.mark.parametrize(
    "change",
    [
        {"discount": 1.5},
        {"training_steps": 0},
        {"evaluated_at_steps": 10**9},
        {"batch_size": 3},
        {"policy_hidden": []},
    ],
)
def test_bad_configuration_is_named(paper_ppo, change):
    with pytest.raises(InputError, match=f"ppo.{next(iter(change))}"):
        PPOConfig(**{**vars(paper_ppo), **change})
