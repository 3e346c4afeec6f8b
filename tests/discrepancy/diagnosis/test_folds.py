"""Folds of rows: both hold rows whatever the logs' lengths, and no block of the bootstrap falls into both."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.discrepancy.diagnosis.scored_rows import alternating_folds, rows_in_blocks

BLOCK_ROWS, FOLD_ROWS = 200, 1200


def used(lengths: list[int], first: int = 0) -> np.ndarray:
    """Rows of logs side by side, from their row `first` on."""
    row = np.arange(max(lengths))
    return (row >= first) & (row < np.array(lengths)[:, None])


@pytest.mark.parametrize("first", [0, 24])
def test_four_logs_of_six_minutes_are_in_stretches_of_a_minute(first: int) -> None:
    is_used = used([7200] * 4, first)
    expected = np.broadcast_to(np.arange(7200) // FOLD_ROWS % 2, is_used.shape)
    fold = alternating_folds(is_used, BLOCK_ROWS, FOLD_ROWS)
    np.testing.assert_array_equal(fold[is_used], expected[is_used])


@given(st.lists(st.integers(30, 3000), min_size=4, max_size=60))
def test_both_folds_hold_rows_of_logs_however_short(lengths: list[int]) -> None:
    is_used = used(lengths)
    fold = alternating_folds(is_used, BLOCK_ROWS, FOLD_ROWS)
    assert np.bincount(fold[is_used], minlength=2).min() > 0
    rows = rows_in_blocks(is_used, fold, np.ones((*is_used.shape, 1), bool), np.ones(1), BLOCK_ROWS)
    in_second = np.bincount(rows.folds.block, rows.folds.fold) / np.bincount(rows.folds.block)
    assert set(in_second.tolist()) == {0.0, 1.0}


def test_many_short_logs_are_halved() -> None:
    is_used = used([600] * 24)
    fold = alternating_folds(is_used, BLOCK_ROWS, FOLD_ROWS)
    assert np.mean(fold[is_used]) == 0.5
