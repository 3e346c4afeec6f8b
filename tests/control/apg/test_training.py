"""Training end to end on a small scale, interrupted and not; and settings that are refused."""

import dataclasses

import jax
import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.training import train
from pipeline.errors import InputError

POINT = 60 * 32 * 5 * 4  # updates x episodes x decisions x ticks


@pytest.fixture(scope="module")
def small() -> APGConfig:
    """Two points of 60 updates."""
    return dataclasses.replace(
        load_section("apg", APGConfig),
        training_steps=2 * POINT,
        environments=32,
        horizon=5,
        learning_rate=1e-2,
        warm_up_updates=5,
        averaging=0.9,
        hidden=[32],
        curve_points=2,
        curve_episodes=16,
    )


@pytest.fixture(scope="module")
def trained(environment, small, episodes):
    return train(environment, small, 7, episodes, lambda _: None, None)


class Killed(Exception):
    pass


@pytest.mark.long
def test_learns_to_approach_the_target(trained):
    assert [point.steps for point in trained.curve] == [0, POINT, 2 * POINT]
    assert trained.policy_steps == 2 * POINT
    untrained, _, learned = (point.metrics.average_return for point in trained.curve)
    assert learned > 0.9 * untrained  # returns are negative: at least a tenth better


@pytest.mark.long
def test_an_interrupted_training_goes_on_from_its_checkpoint(trained, environment, small, episodes, tmp_path):
    def kill(point):
        if point.steps == POINT:
            raise Killed

    with pytest.raises(Killed):
        train(environment, small, 7, episodes, kill, tmp_path)
    points = []
    result = train(environment, small, 7, episodes, points.append, tmp_path)
    assert [point.steps for point in points] == [2 * POINT]  # what was done before is not done again
    assert result.curve == trained.curve  # to the last bit, after the kill as before it
    jax.tree.map(np.testing.assert_array_equal, result.policy, trained.policy)


@pytest.mark.long
def test_weights_that_are_no_numbers_are_refused(environment, small, episodes, tmp_path):
    """Their commands would be those of an arm at rest, whose return is a number."""
    diverging = dataclasses.replace(small, learning_rate=1e30, final_learning_rate=1e30, gradient_norm=1e30)
    with pytest.raises(InputError, match="diverged"):
        train(environment, diverging, 7, episodes, lambda _: None, tmp_path)


@pytest.mark.parametrize(
    "change",
    [{"feedback": 1.5}, {"horizon": 0}, {"noise": -0.1}, {"hidden": []}, {"averaging": 2.0}],
)
def test_bad_configuration_is_named(small, change):
    with pytest.raises(InputError, match=f"apg.{next(iter(change))}"):
        dataclasses.replace(small, **change)


def test_a_bad_objective_is_named(small):
    with pytest.raises(InputError, match=r"apg\.objective\.log_floor is 0"):
        dataclasses.replace(small.objective, log_floor=0.0)
