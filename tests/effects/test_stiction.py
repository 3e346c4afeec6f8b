"""Stiction: which starts are late, and by how much."""

import numpy as np
import pytest

from pipeline.effects.stiction import Stiction

from .conftest import SETTING, respond

pytestmark = pytest.mark.usefixtures("float64")

VALUES = {"mean_extra_time": np.array([0.15, 0.1]), "rest_threshold": np.array([0.4, 0.4])}


def held(*parts: tuple[float, int]) -> np.ndarray:
    """Commands of one joint: (value, steps)."""
    return np.concatenate([np.full(n, value) for value, n in parts])


def passed(one_joint: np.ndarray, joint: int = 0) -> np.ndarray:
    command = np.stack([one_joint, one_joint], axis=-1)
    return respond(Stiction(SETTING), VALUES, command)[:, joint]


def late_s(extra_s: float, rest_s: float) -> float:
    """Closed form, with the threshold of `VALUES`."""
    return extra_s * rest_s**3 / (rest_s**3 + 0.4**3)


def test_a_start_is_late_by_what_its_rest_makes_of_the_extra_time():
    command = held((0, 20), (1, 10), (0, 20), (-1, 10), (0, 8), (1, 10))
    for joint, extra_s in [(0, 0.15), (1, 0.1)]:
        missing_s = SETTING.dt_s * np.abs(command - passed(command, joint))
        np.testing.assert_allclose(missing_s[50:60].sum(), late_s(extra_s, 1.0), atol=1e-9)
        np.testing.assert_allclose(missing_s[68:78].sum(), late_s(extra_s, 0.4), atol=1e-9)
        assert late_s(extra_s, 0.4) == 0.5 * extra_s


def test_starts_after_short_rests_are_hardly_late_and_reversals_are_not():
    command = held((0, 20), (1, 10), (0, 2), (1, 10), (-1, 10), (0, 3), (-1, 5))
    missing_s = SETTING.dt_s * np.abs(command - passed(command))
    np.testing.assert_allclose(missing_s[30:42].sum(), late_s(0.15, 0.1), atol=1e-9)
    assert late_s(0.15, 0.1) < 0.003
    np.testing.assert_array_equal(missing_s[42:52], 0.0)


def test_the_first_start_of_a_log_counts_as_one_after_long_rest():
    np.testing.assert_allclose(passed(held((1, 6))), [0, 0, 0, 1, 1, 1], atol=1e-5)


def test_extra_times_between_steps_weaken_one_step():
    values = {**VALUES, "mean_extra_time": np.array([0.12, 0.0])}  # 2.4 steps
    command = respond(Stiction(SETTING), values, np.ones((5, 2)))
    np.testing.assert_allclose(command[:, 0], [0, 0, 0.6, 1, 1], atol=1e-5)
