"""A size and its deviation against what is known of drawn rows."""

import numpy as np
import pytest
from scipy.stats import t

from pipeline.discrepancy.acceptance.shown import Deviation, Shown

N_ROWS, BLOCK_ROWS = 2000, 100
BLOCK = np.arange(N_ROWS) // BLOCK_ROWS


def noise_of_blocks(random: np.random.Generator) -> np.ndarray:
    """(N, 1) what is the same all through a block."""
    return random.standard_normal(N_ROWS // BLOCK_ROWS)[BLOCK][:, None]


def test_size_and_share_of_an_effect_that_is_half_as_large_as_it_was_fitted() -> None:
    change = np.ones((N_ROWS, 1))
    shown = Shown(change, 0.5 * change)
    assert shown.size == pytest.approx(0.5)
    assert shown.share == pytest.approx(0.0)
    assert Shown(change, change).share == pytest.approx(1.0)


def test_where_there_is_none_small_p_values_are_as_seldom_as_they_say_whatever_is_alike_in_a_block() -> None:
    random, change = np.random.default_rng(0), np.ones((N_ROWS, 1))
    p_values = []
    for _ in range(2000):
        shown = Shown(change, noise_of_blocks(random))
        deviation = shown.deviation_by_blocks(BLOCK)
        assert deviation.freedom == pytest.approx(N_ROWS / BLOCK_ROWS - 1)
        p_values.append(t.sf(shown.size / deviation.value, deviation.freedom))
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.015)


def test_of_what_one_block_alone_shows_nothing_is_known() -> None:
    change = (BLOCK == 3)[:, None].astype(float)
    assert Shown(change, change).deviation_by_blocks(BLOCK).freedom < 0.1


def test_deviations_of_a_sum() -> None:
    """Satterthwaite's own case: equal deviations have the sum of their degrees of freedom; none adds nothing."""
    both = Deviation(3.0, 6.0).and_of(Deviation(3.0, 6.0))
    assert both.value == pytest.approx(np.sqrt(18.0)) and both.freedom == pytest.approx(12.0)
    assert Deviation(0.0, 5.0).and_of(Deviation(2.0, 6.0)) == pytest.approx((2.0, 6.0))
