"""Which sizes are told from none."""

import numpy as np
import pytest

from pipeline.discrepancy.acceptance import size_of_an_effect as sizes
from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS

N_ROWS, FLOOR = 6000, np.array([1.0, 4.0])


def share(of_rows: np.ndarray, noise: float = 0.0) -> float:
    """Of an effect on both joints, of whose size nominal rows hold `of_rows`, (N,), beside noise."""
    random = np.random.default_rng(0)
    change = random.normal(0.0, 1.0, (N_ROWS, 2)) * np.sqrt(FLOOR)
    residual = of_rows[:, None] * change + noise * random.normal(0.0, 1.0, (N_ROWS, 2)) * np.sqrt(FLOOR)
    return sizes.asked_for(change, residual, FLOOR).share


def test_nominal_logs_ask_for_the_share_that_they_hold() -> None:
    assert share(np.full(N_ROWS, 0.6)) == pytest.approx(0.6, rel=0.01)
    assert share(np.zeros(N_ROWS)) == 0.0


def test_shares_of_parts_that_differ_do_not_cancel() -> None:
    sign = np.where(np.arange(N_ROWS) < N_ROWS // 2, 0.6, -0.6)
    assert share(sign) == pytest.approx(0.6, rel=0.01)


def test_noise_alone_asks_for_what_a_fit_of_a_part_scatters_by() -> None:
    by_chance = 2.0 / np.sqrt(2 * N_ROWS / MISFIT_PARTS)
    assert share(np.zeros(N_ROWS), noise=2.0) == pytest.approx(by_chance, rel=0.7)


@pytest.mark.parametrize(("of_size", "is_none"), [(0.0, False), (0.40, False), (0.42, True), (1.0, True)])
def test_a_size_within_what_nominal_logs_ask_for_is_none(of_size: float, is_none: bool) -> None:
    """Student's t with six degrees of freedom exceeds 2.447 either way with 5 % (Fisher's tables)."""
    assert (sizes.why_it_is_misfit(of_size) is not None) == is_none


@pytest.mark.parametrize(("time_s", "n_joints", "is_none"), [(3.0, 2, False), (3.0, 1, True), (0.5, 4, True)])
def test_a_supply_is_of_several_joints_and_slower_than_they_start(time_s, n_joints, is_none) -> None:
    assert (sizes.why_it_is_no_supply({"value": time_s, "unit": "s"}, n_joints) is not None) == is_none
