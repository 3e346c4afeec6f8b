"""The noise floor of joints at rest, against a mean over rows that were picked by hand."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.nominal.floor_at_rest import floor_at_rest
from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED

DT_S = 0.05


def test_rows_half_a_second_after_the_last_command_are_at_rest() -> None:
    command = np.zeros((1, 100, 2))
    command[0, 40:60, 0] = -1.0
    command[0, :, 1] = 1.0  # never rests
    residual = np.random.default_rng(0).standard_normal((100 // ROWS_AVERAGED, 2))
    floor = np.mean(residual**2, axis=0)
    found = floor_at_rest(residual, command, np.ones((1, 100), bool), floor, DT_S)
    # The first half second, of which nobody knows what was commanded before, does not count either: row 9 is the first.
    resting = [*range(5, 20), *range(35, 50)]
    assert found[0] == pytest.approx(min(np.mean(residual[resting, 0] ** 2) / floor[0], 1.0))
    assert found[1] == 1.0


def test_a_log_shorter_than_half_a_second_has_no_rest() -> None:
    found = floor_at_rest(np.ones((2, 1)), np.zeros((1, 4, 1)), np.ones((1, 4), bool), np.ones(1), DT_S)
    assert found.tolist() == [1.0]
