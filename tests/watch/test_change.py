"""Onsets and trends of series that were drawn with known ones."""

import numpy as np
import pytest

from pipeline.watch.change import onset_of, trend_of


def test_a_step_begins_where_it_was_put() -> None:
    random = np.random.default_rng(0)
    values = 5.0 + 0.1 * random.standard_normal(30)
    values[18:] += 1.0
    onset = onset_of(values, 5.0, 0.1)
    assert (onset.first, onset.interval, onset.is_ramp) == (18, (18, 18), False)


def test_a_ramp_begins_within_its_interval() -> None:
    covered, ramps = 0, 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        values = random.standard_normal(40)
        values[15:] += 0.5 * np.arange(1, 26)
        onset = onset_of(values, 0.0, 1.0)
        ramps += onset.is_ramp
        covered += onset.interval[0] <= 15 <= onset.interval[1]
    assert ramps >= 38
    assert covered >= 34


def test_sessions_that_say_nothing_are_no_onset() -> None:
    values = np.array([0.1, -0.2, 0.0, np.nan, 4.0, 4.1, np.nan, 3.9])
    assert onset_of(values, 0.0, 0.2).first == 4


def test_a_limit_is_told_only_where_growth_is_sure() -> None:
    random = np.random.default_rng(1)
    grows = 0.01 * np.arange(20) + 0.002 * random.standard_normal(20)
    trend = trend_of(-grows, 0.0, 0.3)  # whichever way it goes
    assert trend is not None and trend.reaches is not None
    assert trend.ci95[0] < -0.01 < trend.ci95[1]
    assert 9 <= trend.reaches[0] <= 11 <= trend.reaches[1] <= 14
    stays = trend_of(0.2 + 0.02 * random.standard_normal(20), 0.0, 0.3)
    assert stays is not None and stays.reaches is None
    beyond = trend_of(0.3 + grows, 0.0, 0.3)
    assert beyond is not None and beyond.reaches is None


@pytest.mark.parametrize("n", [1, 4])
def test_few_sessions_are_no_trend(n: int) -> None:
    assert trend_of(np.arange(float(n)), 0.0, 1.0) is None
