"""Held-out gains against sums of squares computed by hand."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pipeline.discrepancy.selection.regression import Folds, bounded_least_squares, evidence

RANDOM = np.random.default_rng(0)
N = 600
FOLDS = Folds(fold=(np.arange(N) // 100) % 2, block=np.arange(N) // 50, n_blocks=N // 50)


def test_coefficients_are_those_of_least_squares_and_the_gain_is_held_out() -> None:
    a = RANDOM.standard_normal((N, 2))
    y = a @ np.array([0.7, -0.2]) + 0.3 * RANDOM.standard_normal(N)
    found = evidence(y, y, a, FOLDS, np.full(2, -5.0), np.full(2, 5.0))
    np.testing.assert_allclose(found.coefficients, np.linalg.lstsq(a, y, rcond=None)[0], rtol=1e-4)
    expected = 0.0
    for held_out in (0, 1):
        used, other = FOLDS.fold != held_out, FOLDS.fold == held_out
        theta = np.linalg.lstsq(a[used], y[used], rcond=None)[0]
        expected += np.sum(y[other] ** 2) - np.sum((y[other] - a[other] @ theta) ** 2)
    assert found.gain == pytest.approx(expected, rel=1e-4)
    assert found.gain_by_block.sum() == pytest.approx(found.gain)


def test_a_useless_regressor_gains_nothing_on_average() -> None:
    gains = []
    for _ in range(200):
        y = RANDOM.standard_normal(N)
        gains.append(
            evidence(y, y, RANDOM.standard_normal((N, 1)), FOLDS, np.array([-9.0]), np.array([9.0])).gain
        )
    assert np.mean(gains) < 0.5  # in-sample it would be one


def test_bounds_hold() -> None:
    a = RANDOM.standard_normal((N, 1))
    found = evidence(2.0 * a[:, 0], 2.0 * a[:, 0], a, FOLDS, np.array([0.0]), np.array([0.5]))
    assert found.coefficients[0] == pytest.approx(0.5)


def test_without_coefficients_the_candidate_itself_is_judged() -> None:
    before, after = RANDOM.standard_normal(N), 0.5 * RANDOM.standard_normal(N)
    found = evidence(before, after, np.zeros((N, 0)), FOLDS, np.zeros(0), np.zeros(0))
    assert found.gain == pytest.approx(np.sum(before**2) - np.sum(after**2))


def test_what_one_half_of_the_rows_hardly_excites_is_not_believed_on_the_other() -> None:
    a = np.zeros((N, 1))
    excited = FOLDS.fold == 0
    a[excited, 0] = RANDOM.standard_normal(excited.sum())
    a[~excited, 0] = 1e-3 * RANDOM.standard_normal((~excited).sum())
    y = 0.5 * a[:, 0] + 0.1 * RANDOM.standard_normal(N)
    bounds = np.array([-2.0]), np.array([2.0])
    believed, doubted = (evidence(y, y, a, FOLDS, *bounds, ridge) for ridge in (0.0, 10.0 * 0.1**2 / 0.4**2))
    assert believed.gain < -10.0
    assert doubted.gain > -0.1
    assert doubted.coefficients[0] == pytest.approx(0.5, abs=0.02)  # on all rows it is excited


def test_a_ridge_adds_its_square_to_what_is_made_least() -> None:
    a = RANDOM.standard_normal((N, 2))
    y = a @ np.array([0.7, -0.2]) + 0.3 * RANDOM.standard_normal(N)
    ridge = np.array([30.0, 200.0])
    found = bounded_least_squares(a, y, np.full(2, -5.0), np.full(2, 5.0), ridge)
    stacked = np.vstack([a, np.diag(np.sqrt(ridge))]), np.concatenate([y, np.zeros(2)])
    np.testing.assert_allclose(found, np.linalg.lstsq(*stacked, rcond=None)[0], rtol=1e-4)
    np.testing.assert_allclose(
        bounded_least_squares(a, y, np.full(2, -5.0), np.array([0.3, 5.0]), ridge),
        lsq_linear(*stacked, bounds=([-5.0, -5.0], [0.3, 5.0])).x,
        rtol=1e-3,
    )
