"""E-values by their definition, and the t from which on one is large enough."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import t

from pipeline.discrepancy.acceptance.e_value import as_told, e_value_of, smallest_t


@pytest.mark.parametrize("p_value", [1e-12, 1e-3, 0.05, 0.5, 0.99])
def test_it_is_the_mean_over_all_powers(p_value: float) -> None:
    mean, _ = quad(lambda kappa: kappa * p_value ** (kappa - 1.0), 0.0, 1.0)
    assert e_value_of(p_value) == pytest.approx(mean, rel=1e-6)


def test_it_is_one_on_average_where_there_is_no_effect() -> None:
    """Over p-values that are as probable as they say; beyond e⁻⁶⁰⁰ the integral has 1 / 600 left."""
    mean, _ = quad(lambda u: e_value_of(np.exp(-u)) * np.exp(-u), 1e-3, 600.0, limit=500)
    assert mean == pytest.approx(1.0, abs=0.005)
    assert as_told(e_value_of(1.0)) == {"e_value": 0.5, "p_value": 1.0}


@pytest.mark.parametrize("freedom", [2.0, 6.0, 40.0])
@pytest.mark.parametrize("e_value", [2.0, 20.0, 1e6])
def test_from_the_smallest_t_on_an_e_value_is_so_large(e_value: float, freedom: float) -> None:
    assert e_value_of(float(t.sf(smallest_t(e_value, freedom), freedom))) == pytest.approx(e_value, rel=1e-6)
