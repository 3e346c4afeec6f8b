"""Which effects on several joints are one cause."""

from dataclasses import replace

import pytest

from pipeline.discrepancy.families.late_channel import (
    are_equal_delays,
    late_channel,
    set_in_together,
)
from pipeline.discrepancy.families.whole_machine import of_one_cause
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import effects_of
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate


def delays(*seconds: float) -> list[Candidate]:
    return [bare_candidate("delay", joint, added_delay=value) for joint, value in enumerate(seconds)]


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
    assert of_one_cause(delays(0.1, 0.1, 0.1), range(3)) == ["delay"]
    assert of_one_cause(delays(0.1, 0.1), range(2)) == ["delay"]  # the third joint hardly moves
    assert of_one_cause(delays(0.1, 0.1), range(3)) == []
    assert of_one_cause(delays(0.1), range(1)) == []
    later = [replace(delay, onset=joint) for joint, delay in enumerate(delays(0.1, 0.1))]
    assert of_one_cause(later, range(2)) == []  # they did not become late at the same time


def test_two_delays_may_have_set_in_at_one_moment():
    always, other = delays(0.1, 0.1)
    early, middle, late = (
        replace(always, onset=begin + 5, onset_between=(begin, begin + 10)) for begin in (0, 8, 16)
    )
    assert set_in_together(always, other) and not set_in_together(always, early)
    assert set_in_together(early, middle) and set_in_together(middle, late)
    assert not set_in_together(early, late)


def test_dead_bands_on_several_joints_are_one_cause_and_gains_are_not():
    found = [bare_candidate(family, joint) for family in ("other:dead_band", "gain") for joint in (0, 1)]
    assert of_one_cause(found, range(3)) == ["other:dead_band"]


def test_a_joint_that_hardly_moves_neither_makes_a_channel_nor_refutes_it():
    like, unlike = delays(0.1, 0.1, 0.1), delays(0.1, 0.1, 0.3)
    assert late_channel(like, (0, 1)) == like
    assert late_channel(unlike, (0, 1)) == unlike[:2]
    assert late_channel(unlike, range(3)) == []
    assert late_channel(like[:2], (0,)) == late_channel(like[:2], ()) == []
    effects = effects_of([SelectedEffect(c) for c in unlike], (0, 1))
    assert {(effect.family, tuple(effect.joints)) for effect in effects} == {
        ("timing", (0, 1)),
        ("delay", (2,)),
    }
