"""What takes the certainty from names that are right by themselves."""

from pipeline.discrepancy.decide_again import with_doubts_of_the_oil
from pipeline.discrepancy.found import Found
from tests.discrepancy.bare_candidate import bare_candidate


def test_joints_that_respond_late_one_like_the_other_may_be_cold():
    found = [Found(bare_candidate("lag", joint)) for joint in (0, 2)]
    found.append(Found(bare_candidate("stiction", 1)))
    screened = [bare_candidate("thermal_drift", joint) for joint in range(4)]
    first, second, alone = with_doubts_of_the_oil(found, screened)
    assert first.equivalents == [screened[0]]
    assert second.equivalents == [screened[2]]
    assert alone.equivalents == []


def test_gains_of_two_joints_have_two_causes():
    found = [Found(bare_candidate("gain", joint)) for joint in (0, 1)]
    screened = [bare_candidate("thermal_drift", joint) for joint in range(2)]
    assert with_doubts_of_the_oil(found, screened) == found
