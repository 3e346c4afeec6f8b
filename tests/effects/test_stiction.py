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


def test_a_start_after_a_long_rest_is_late_by_the_extra_time():
    command = held((0, 20), (1, 10), (0, 20), (-1, 10))
    for joint, late in [(0, 3), (1, 2)]:  # 0.15 s and 0.1 s are 3 and 2 steps
        expected = command.copy()
        expected[20 : 20 + late] = expected[50 : 50 + late] = 0.0
        np.testing.assert_allclose(passed(command, joint), expected, atol=1e-5)


def test_starts_after_short_rests_and_reversals_are_not_late():
    command = held((0, 20), (1, 10), (0, 4), (1, 10), (-1, 10), (0, 3), (-1, 5))
    np.testing.assert_allclose(passed(command)[30:], command[30:], atol=0.03)  # the threshold is soft


def test_the_first_start_of_a_log_counts_as_one_after_long_rest():
    np.testing.assert_allclose(passed(held((1, 6))), [0, 0, 0, 1, 1, 1], atol=1e-9)


def test_extra_times_between_steps_weaken_one_step():
    values = {**VALUES, "mean_extra_time": np.array([0.12, 0.0])}  # 2.4 steps
    command = respond(Stiction(SETTING), values, np.ones((5, 2)))
    np.testing.assert_allclose(command[:, 0], [0, 0, 0.6, 1, 1], atol=1e-9)
