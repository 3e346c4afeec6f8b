"""The gate against noise: what is nothing does not pass more often than stated."""

import numpy as np

from pipeline.discrepancy.gate import can_be_shifted, lower_bound, placebo_p, pooled, rank_p
from pipeline.discrepancy.regression import Folds
from pipeline.discrepancy.screen import Rows

N, BLOCK = 2000, 50
ROWS = Rows(
    is_used=np.ones((1, N), bool),
    folds=Folds(np.zeros(N, int), np.arange(N) // BLOCK, N // BLOCK),
    floor=np.ones(1),
    weight=np.ones((N, 1)),
)


def coloured(random: np.random.Generator) -> np.ndarray:
    """Noise with a correlation over some ten rows."""
    return np.convolve(random.standard_normal(N + 20), np.ones(10) / np.sqrt(10.0), "same")[:N]


def test_placebos_reject_coloured_noise_as_often_as_they_state() -> None:
    random = np.random.default_rng(1)
    p = np.array([placebo_p(coloured(random), coloured(random), 1, seed) for seed in range(300)])
    assert np.mean(p < 0.05) < 0.09
    assert np.mean(p < 0.5) > 0.35


def test_a_true_change_beats_its_placebos_even_after_correction() -> None:
    random = np.random.default_rng(2)
    change = coloured(random)
    assert placebo_p(0.5 * change + coloured(random), change, 100, 0) < 1e-4
    assert placebo_p(np.ones(N), np.zeros(N), 100, 0) == 1.0


def test_lower_bound_lies_below_the_estimate_and_covers_nothing_when_there_is_nothing() -> None:
    random = np.random.default_rng(3)
    before = coloured(random)
    share, bound = lower_bound(before, 0.5 * before, ROWS, 300, 0.95, 0)
    assert abs(share - 0.75) < 1e-9
    assert abs(bound - 0.75) < 1e-9
    share, bound = lower_bound(before, coloured(random), ROWS, 300, 0.95, 0)
    assert bound < share
    assert bound < 0.02


def test_mean_gain_per_block() -> None:
    random = np.random.default_rng(4)
    p = np.array([rank_p(random.standard_normal(40), 1) for _ in range(400)])
    assert 0.02 < np.mean(p < 0.05) < 0.09
    assert rank_p(1.0 + 0.1 * random.standard_normal(40), 5) < 1e-8


def test_a_creep_at_rest_has_no_placebos_in_time() -> None:
    random = np.random.default_rng(5)
    creep = np.where(random.random(N // 20).repeat(20) < 0.8, 0.02, 0.0)
    assert not can_be_shifted(creep)
    assert can_be_shifted(coloured(random))
    assert can_be_shifted(np.where(random.random(N // 20).repeat(20) < 0.15, 0.3, 0.0))


def test_joints_are_pooled_in_units_of_their_scales() -> None:
    residual = np.array([[3.0, 40.0, 7.0], [0.0, -10.0, 7.0]])
    together = pooled(residual, [0, 1], np.array([1.0, 100.0, 1.0]))
    np.testing.assert_allclose(together, [5.0, 1.0])
