"""The paired difference against simulated pairs, and the rule of what may be promoted."""

import numpy as np
import pytest

from pipeline.control.repair.comparison import Comparison, PairedRate


def pairs(won, lost, both, neither):
    before = np.repeat([False, True, True, False], [won, lost, both, neither])
    after = np.repeat([True, False, True, False], [won, lost, both, neither])
    return PairedRate.of(before, after)


def test_rates_and_difference_are_those_of_the_counts():
    rate = pairs(won=30, lost=10, both=40, neither=20)
    assert (rate.before, rate.after) == (0.5, 0.7)
    assert rate.difference["value"] == pytest.approx(0.2)
    # by hand: 20 / 102, 1.96 sqrt(41 - 400 / 102) / 102
    np.testing.assert_allclose(rate.ci95, (0.19608 - 0.11702, 0.19608 + 0.11702), atol=1e-4)


def test_the_interval_holds_the_difference_as_often_as_it_says():
    """Of 60 pairs, whose events go together."""
    random, held = np.random.default_rng(0), []
    for _ in range(2000):
        common = random.random(60)
        before, after = common < 0.6, np.where(random.random(60) < 0.8, common, random.random(60)) < 0.7
        lower, upper = PairedRate.of(before, after).ci95
        held.append(lower <= 0.1 <= upper)
    assert 0.93 < np.mean(held) < 0.99


def test_pairs_that_do_not_differ_have_an_interval_that_shrinks_with_their_number():
    few, many = (pairs(0, 0, n, 0).ci95 for n in (20, 500))
    assert few[0] < -0.05 and few[1] > 0.05
    assert -0.006 < many[0] < 0.0 < many[1] < 0.006


SAME = pairs(0, 0, 450, 50)


@pytest.mark.parametrize(
    ("success", "outside", "promotable", "reason"),
    [
        (pairs(100, 10, 340, 50), SAME, True, "points higher"),
        (SAME, pairs(5, 60, 20, 415), True, "less often"),
        (SAME, SAME, False, "neither"),
        (pairs(20, 50, 380, 50), pairs(5, 60, 20, 415), False, "points lower"),  # safer, but misses more
        (pairs(100, 10, 340, 50), pairs(60, 5, 20, 415), False, "more often"),  # better, but leaves W+
        (pairs(2, 0, 2, 0), pairs(0, 0, 0, 4), False, "lower"),  # four targets prove nothing
    ],
)
def test_what_may_be_promoted(success, outside, promotable, reason):
    found, why = Comparison(500, success, outside).verdict(0.05)
    assert found is promotable
    assert reason in why
