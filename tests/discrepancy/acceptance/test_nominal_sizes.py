"""Sizes that nominal logs ask for, against residuals that hold a known share of an effect."""

import numpy as np
import pytest
from scipy.stats import ttest_ind

from pipeline.discrepancy.acceptance.nominal_sizes import NominalSizes, nominal_sizes
from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS
from pipeline.discrepancy.acceptance.shown import Shown

N_ROWS = 6000
PART = np.arange(N_ROWS) * MISFIT_PARTS // N_ROWS


def sizes(of_rows: np.ndarray, noise: float = 0.0) -> NominalSizes:
    """Of an effect on two joints, of whose size nominal rows hold `of_rows`, (N,), beside noise."""
    random = np.random.default_rng(0)
    change = random.normal(0.0, 1.0, (N_ROWS, 2))
    shown = Shown(change, of_rows[:, None] * change + noise * random.normal(0.0, 1.0, (N_ROWS, 2)))
    return nominal_sizes(shown, shown.squares / N_ROWS)


def of_parts(values: np.ndarray) -> NominalSizes:
    """Of parts that ask for just these."""
    change = np.ones((N_ROWS, 1))
    return nominal_sizes(Shown(change, values[PART][:, None]), 1.0)


def test_what_is_further_than_usual_is_told_as_a_t_test_tells_it() -> None:
    values, further = np.random.default_rng(1).normal(0.5, 0.1, MISFIT_PARTS), 0.9
    told = of_parts(values)
    t = (further - told.usual) / told.deviation.value
    assert t == pytest.approx(ttest_ind([further], values).statistic)
    assert told.deviation.freedom == MISFIT_PARTS - 1


def test_misfit_in_the_other_direction_is_no_evidence() -> None:
    told = of_parts(np.full(MISFIT_PARTS, -0.3))
    assert told.usual == 0.0
    assert told.deviation == pytest.approx((0.3, MISFIT_PARTS))


def test_parts_that_differ_do_not_cancel() -> None:
    told = of_parts(np.array([0.6, -0.6, 0.6, -0.6, 0.6, -0.6]))
    assert told.deviation.value == pytest.approx(0.6)


def test_noise_alone_asks_for_what_a_fit_of_a_part_scatters_by() -> None:
    by_chance = 2.0 / np.sqrt(2 * N_ROWS / MISFIT_PARTS)
    assert sizes(np.zeros(N_ROWS), noise=2.0).deviation.value == pytest.approx(by_chance, rel=0.7)


def test_rows_that_show_little_scatter_more_and_those_that_show_much_no_less() -> None:
    told = of_parts(np.array([0.3, -0.3, 0.3, -0.3, 0.3, -0.3]))
    of_a_part = N_ROWS / MISFIT_PARTS
    for squares, expected in ((of_a_part, 0.3), (of_a_part / 4.0, 0.6), (4.0 * of_a_part, 0.3)):
        assert told.deviation_on(squares).value == pytest.approx(expected)
