"""Placebos against noise, and against what is no chance: at the wrong time, in the wrong order, on the wrong joint."""

import numpy as np

from pipeline.discrepancy.acceptance.placebos import can_be_shifted, explains_other_joints, placebo_p
from tests.discrepancy.coloured_noise import N, coloured


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


def test_a_creep_at_rest_has_no_placebos_in_time() -> None:
    random = np.random.default_rng(5)
    creep = np.where(random.random(N // 20).repeat(20) < 0.8, 0.02, 0.0)
    assert not can_be_shifted(creep)
    assert can_be_shifted(coloured(random))
    assert can_be_shifted(np.where(random.random(N // 20).repeat(20) < 0.15, 0.3, 0.0))


def test_what_fits_in_any_order_of_its_pieces_is_no_effect() -> None:
    """A slow course, alike in every piece but for its size, comes out as well in another order, though not shifted."""
    row = np.arange(N)
    change = np.sin(2.0 * np.pi * row / 100.0)
    residual = change + coloured(np.random.default_rng(6))
    assert placebo_p(residual, change, 1, 0) > 0.3


def test_a_change_that_explains_another_joint_as_well_is_not_of_its_own() -> None:
    random = np.random.default_rng(7)
    change = coloured(random)
    own, other = 0.5 * change + coloured(random), coloured(random)
    residual = np.stack([own, other], axis=1)
    left = np.stack([own - 0.5 * change, other], axis=1)
    assert not explains_other_joints(change, residual, left, 0)
    left[:, 1] -= 0.6 * change
    assert explains_other_joints(change, residual, left, 0)
    assert not explains_other_joints(change, residual[:, :1], left[:, :1], 0)
