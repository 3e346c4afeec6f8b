"""What nominal logs ask for of an effect, against residuals that hold a known share of it."""

import numpy as np
import pytest

from pipeline.discrepancy.acceptance.nominal_scatter import nominal_scatter
from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS
from pipeline.discrepancy.acceptance.shown import Shown

N_ROWS = 6000


def share(of_rows: np.ndarray, noise: float = 0.0) -> float:
    """Of an effect on two joints, of whose size nominal rows hold `of_rows`, (N,), beside noise."""
    random = np.random.default_rng(0)
    change = random.normal(0.0, 1.0, (N_ROWS, 2))
    shown = Shown(change, of_rows[:, None] * change + noise * random.normal(0.0, 1.0, (N_ROWS, 2)))
    return nominal_scatter(shown, shown.squares / N_ROWS).share


def test_nominal_logs_ask_for_the_share_that_they_hold() -> None:
    assert share(np.full(N_ROWS, 0.6)) == pytest.approx(0.6, rel=0.01)
    assert share(np.zeros(N_ROWS)) == 0.0


def test_shares_of_parts_that_differ_do_not_cancel() -> None:
    sign = np.where(np.arange(N_ROWS) < N_ROWS // 2, 0.6, -0.6)
    assert share(sign) == pytest.approx(0.6, rel=0.01)


def test_noise_alone_asks_for_what_a_fit_of_a_part_scatters_by() -> None:
    by_chance = 2.0 / np.sqrt(2 * N_ROWS / MISFIT_PARTS)
    assert share(np.zeros(N_ROWS), noise=2.0) == pytest.approx(by_chance, rel=0.7)


def test_rows_that_show_little_scatter_more_and_those_that_show_much_no_less() -> None:
    change = np.ones((N_ROWS, 1))
    scatter = nominal_scatter(Shown(change, 0.3 * change), 1.0)
    of_a_part = N_ROWS / MISFIT_PARTS
    for squares, expected in ((of_a_part, 0.3), (of_a_part / 4.0, 0.6), (4.0 * of_a_part, 0.3)):
        assert scatter.on(squares).value == pytest.approx(expected)
