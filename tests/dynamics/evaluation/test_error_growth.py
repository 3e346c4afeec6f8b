"""Error growth against loops over windows, and bands against the spread over many logs."""

import numpy as np
import pytest

from pipeline.dynamics.evaluation.error_growth import ErrorGrowthConfig, error_growth
from pipeline.errors import InputError
from tests.dynamics.conftest import make_trajectory, random_trajectory


class StandsStill:
    """Predicts the start row's configuration."""

    rows_before = 0

    def predict(self, trajectory, starts, horizon):
        return np.repeat(trajectory.q[starts][:, None], horizon, axis=1)


class Diverges(StandsStill):
    def predict(self, trajectory, starts, horizon):
        return np.full((len(starts), horizon, 2), np.nan)


def config(**changes) -> ErrorGrowthConfig:
    values = {"horizon": 50, "stride": 7, "resamples": 400, "confidence": 0.95, "seed": 0}
    return ErrorGrowthConfig(**(values | changes))


def walk(seed: int, n_rows: int):
    steps = 0.01 * np.random.default_rng(seed).normal(size=(n_rows, 2))
    return make_trajectory(np.cumsum(steps, axis=0), np.zeros((n_rows, 2)), np.zeros((n_rows, 2)))


def test_errors_equal_loops_over_windows():
    logs = [random_trajectory(seed, n_rows) for seed, n_rows in ((0, 400), (1, 91), (2, 90))]
    squares = [
        (log.q[start] - log.q[start + 1 : start + 51]) ** 2
        for log in logs
        for start in range(40, len(log) - 50, 7)
    ]
    growth = error_growth(StandsStill(), logs, config())
    np.testing.assert_allclose(growth.rmse, np.sqrt(np.mean(squares, axis=0)))
    assert growth.n_windows == len(squares)
    assert growth.n_blocks == 7 + 1  # 359 and 50 rows follow row 40; 49 are too few


def test_bands_cover_the_true_error():
    """A random walk's error after h steps is 0.01 sqrt(h); 95 % bands hold it in most of 40 logs."""
    truth = 0.01 * np.sqrt(np.arange(1, 51))[:, None]
    inside, wrongly_independent = [], []
    for seed in range(40):
        growth = error_growth(StandsStill(), [walk(seed, 4000)], config(resamples=200))
        inside.append((growth.lower < truth) & (truth < growth.upper))
        # What bands would be if overlapping windows counted as independent.
        half = 1.96 * growth.rmse / np.sqrt(2 * growth.n_windows)
        wrongly_independent.append(np.abs(growth.rmse - truth) < half)
    assert 0.82 < np.mean(inside) < 0.99
    at_the_end = np.mean([x[-1] for x in inside]), np.mean([x[-1] for x in wrongly_independent])
    assert at_the_end[0] > 0.8 > 0.7 > at_the_end[1]


def test_equal_seeds_give_equal_bands():
    first, second = (error_growth(StandsStill(), [walk(0, 1500)], config()) for _ in range(2))
    np.testing.assert_array_equal(first.lower, second.lower)
    assert np.all(first.lower < first.rmse) and np.all(first.rmse < first.upper)


def test_short_logs_give_shorter_horizons_and_no_bands():
    growth = error_growth(StandsStill(), [walk(0, 80)], config())
    assert growth.rmse.shape == (39, 2)
    assert np.isnan(growth.lower).all() and np.isnan(growth.upper).all()
    with pytest.raises(InputError, match="longer than 41 rows"):
        error_growth(StandsStill(), [walk(0, 41)], config())


def test_diverged_predictions_stay_numbers():
    growth = error_growth(Diverges(), [walk(0, 1500)], config())
    assert growth.rmse.min() == growth.rmse.max() == 1e6


def test_mistakes_are_named():
    with pytest.raises(InputError, match=r"judge\.growth\.confidence is 1\.0"):
        config(confidence=1.0)
