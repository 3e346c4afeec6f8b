"""The probability that nothing has changed, on cases of which half have an effect."""

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.discrepancy.acceptance.e_value import e_value_of
from pipeline.discrepancy.acceptance.probability_none import probability_none


def test_it_is_never_too_small() -> None:
    """Effects are large or small: among cases that are told below q, at most q are without."""
    random, n = np.random.default_rng(2), 20_000
    has_effect = random.random(n) < 0.5
    z = random.standard_normal(n) + has_effect * random.choice([1.0, 3.0, 6.0], n)
    told = np.array([probability_none([e_value_of(p)], is_excited=True) for p in norm.sf(z)])
    for most in (0.3, 0.05, 0.001):
        assert np.mean(~has_effect[told < most]) < most


def test_the_strongest_effect_counts_and_where_none_is_told_no_change_is_likelier_if_joints_move() -> None:
    assert probability_none([], is_excited=True) == pytest.approx(2 / 3)
    assert probability_none([], is_excited=False) == 0.5
    assert probability_none([3.0, 99.0], is_excited=True) == pytest.approx(0.01)
