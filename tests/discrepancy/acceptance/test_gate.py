"""The gate against noise: what is nothing does not pass more often than stated."""

import numpy as np

from pipeline.discrepancy.acceptance.gate import lower_bound, pooled, rank_p, where_it_acts
from pipeline.discrepancy.acceptance.placebos import placebo_p
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.selection.regression import Folds
from tests.discrepancy.coloured_noise import N, coloured

BLOCK = 50
ROWS = ScoredRows(
    is_used=np.ones((1, N), bool),
    folds=Folds(np.zeros(N, int), np.arange(N) // BLOCK, N // BLOCK),
    floor=np.ones(1),
    weight=np.ones((N, 1)),
)


def test_lower_bound_lies_below_the_estimate_and_covers_nothing_when_there_is_nothing() -> None:
    random = np.random.default_rng(3)
    before = coloured(random)
    share, bound = lower_bound(before, 0.5 * before, ROWS, 300, 0.95, 0)
    assert abs(share - 0.75) < 1e-9
    assert abs(bound - 0.75) < 1e-9
    share, bound = lower_bound(before, coloured(random), ROWS, 300, 0.95, 0)
    assert bound < share
    assert bound < 0.02


def rare(random: np.random.Generator) -> np.ndarray:
    """A change in one block of all, as of a place that is seldom met."""
    change, first = np.zeros(N), BLOCK * random.integers(N // BLOCK)
    change[first : first + BLOCK] = 4.0 * np.sin(np.linspace(0.0, np.pi, BLOCK))
    return change


def bounds(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    acts = where_it_acts(before, after, ROWS)
    everywhere, there = (lower_bound(before, after, ROWS, 300, 0.9, 0, only)[1] for only in (None, acts))
    return everywhere, there


def test_what_one_block_shows_clearly_is_not_held_against_how_seldom_it_is_met() -> None:
    random = np.random.default_rng(5)
    change, noise = rare(random), 0.3 * coloured(random)
    everywhere, there = bounds(noise + change, noise)
    assert everywhere <= 0.0 < 0.8 < there
    assert np.unique(ROWS.folds.block[where_it_acts(noise + change, noise, ROWS)]).size == 1


def test_a_rare_change_that_is_none_seldom_passes_both_of_what_is_asked() -> None:
    random = np.random.default_rng(6)
    passed = []
    for _ in range(150):
        before, change = coloured(random), rare(random)
        size = max(0.0, float(change @ before) / float(change @ change))  # the most that it could explain
        p_value = placebo_p(before, size * change, 1, 0)
        passed.append(bounds(before, before - size * change)[1] > 0.01 and p_value < 0.01)
    assert np.mean(passed) < 0.05


def test_mean_gain_per_block() -> None:
    random = np.random.default_rng(4)
    p = np.array([rank_p(random.standard_normal(40), 1) for _ in range(400)])
    assert 0.02 < np.mean(p < 0.05) < 0.09
    assert rank_p(1.0 + 0.1 * random.standard_normal(40), 5) < 1e-8


def test_joints_are_pooled_in_units_of_their_scales() -> None:
    residual = np.array([[3.0, 40.0, 7.0], [0.0, -10.0, 7.0]])
    together = pooled(residual, [0, 1], np.array([1.0, 100.0, 1.0]))
    np.testing.assert_allclose(together, [5.0, 1.0])
