"""Which effects on several joints are one cause."""

import numpy as np
import pytest

from pipeline.discrepancy.screen import Candidate
from pipeline.discrepancy.whole_machine import are_equal_delays, of_one_cause


def candidate(family: str, joint: int, **point: float) -> Candidate:
    return Candidate(family, joint, None, point, (), np.zeros(0), 1.0, 0.5, np.ones(4))


def delays(*seconds: float) -> list[Candidate]:
    return [candidate("delay", joint, added_delay=value) for joint, value in enumerate(seconds)]


@pytest.mark.parametrize(
    ("seconds", "equal"),
    [
        ((0.10, 0.10, 0.10), True),
        ((0.10, 0.06, 0.10), True),  # joints respond differently after the channel
        ((0.30, 0.24, 0.31), True),
        ((0.065, 0.012, 0.012), False),  # one late joint, and what a recording's phase leaves
        ((0.10, 0.04, 0.10), False),
        ((0.30, 0.20, 0.31), False),
    ],
)
def test_delays_of_one_channel_are_about_equal(seconds, equal):
    assert are_equal_delays(delays(*seconds)) is equal


def test_a_late_channel_is_one_cause_only_where_all_joints_are_late():
    assert of_one_cause(delays(0.1, 0.1, 0.1), 3) == ["delay"]
    assert of_one_cause(delays(0.1, 0.1), 3) == []
    assert of_one_cause(delays(0.1), 1) == []


def test_dead_bands_on_several_joints_are_one_cause_and_gains_are_not():
    found = [candidate(family, joint) for family in ("other:dead_band", "gain") for joint in (0, 1)]
    assert of_one_cause(found, 3) == ["other:dead_band"]
