"""Purposes of rows: no row has two, purges lie between, every purpose gets its share."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.discrepancy.diagnosis.splits import Purpose, SplitConfig, split_rows

CONFIG = SplitConfig(block_s=60.0, smallest_block_s=20.0, blocks=9, trajectories=6, purge_s=5.5)
DT_S = 0.05


@given(st.lists(st.integers(400, 20000), min_size=1, max_size=5))
def test_blocks_of_different_purposes_are_kept_apart(lengths: list[int]) -> None:
    purposes, _ = split_rows(lengths, DT_S, CONFIG)
    for length, rows in zip(lengths, purposes, strict=True):
        assert rows.shape == (length,)
        last, place = None, 0
        for index, purpose in enumerate(rows.tolist()):
            if purpose == Purpose.purged:
                continue
            if last is not None and purpose != last:
                assert (index - place) * DT_S > CONFIG.purge_s
            last, place = purpose, index


def test_long_logs_serve_every_purpose_alike() -> None:
    purposes, _ = split_rows([7200, 7200], DT_S, CONFIG)
    counts = np.bincount(np.concatenate(purposes), minlength=4)
    assert counts[1:].min() > 0.25 * counts.sum()


@pytest.mark.parametrize("minutes", [6, 12])
def test_two_logs_begin_differently_and_end_with_rows_to_find_and_to_confirm_what_sets_in_late(
    minutes: int,
) -> None:
    purposes, _ = split_rows([1200 * minutes, 1200 * minutes], DT_S, CONFIG)
    assert purposes[0][0] != purposes[1][0]
    for rows in purposes:
        last_blocks = rows[-2400:]
        assert (last_blocks == Purpose.confirm).sum() * DT_S > 50.0
        assert np.isin(last_blocks, (Purpose.fit, Purpose.select)).sum() * DT_S > 50.0


def test_many_trajectories_are_split_as_wholes() -> None:
    purposes, rule = split_rows([900, 800, 700, 600, 500, 400], DT_S, CONFIG)
    assert [set(rows.tolist()) for rows in purposes] == [{1}, {2}, {3}, {1}, {2}, {3}]
    assert "whole trajectories" in rule


def counts(purposes: list[np.ndarray]) -> np.ndarray:
    """Rows to fit, to select and to confirm."""
    return np.bincount(np.concatenate(purposes), minlength=4)[1:]


@pytest.mark.parametrize("lengths", [[7200, 7200], [7202, 7153], [7153, 7202], [7299, 7101]])
def test_two_logs_of_six_blocks_are_cut_with_one_to_find_and_one_to_confirm_at_either_end(lengths) -> None:
    purposes, _ = split_rows(lengths, DT_S, CONFIG)
    middles = [rows[600::1200].tolist() for rows in purposes]
    assert middles == [[1, 2, 3, 1, 2, 3], [2, 3, 1, 2, 3, 1]]


def test_pieces_of_a_log_that_gaps_cut_are_no_trajectories_to_be_dealt() -> None:
    lengths = [150, 9000, 200, 130, 400, 180, 300, 160]
    purposes, rule = split_rows(lengths, DT_S, CONFIG)
    assert "blocks" in rule
    assert [len(rows) for rows in purposes] == lengths
    assert counts(purposes).min() > 0.25 * sum(lengths)


@given(st.lists(st.integers(100, 9000), min_size=6, max_size=20))
@example([624, 610, 783, 846, 729, 7445, 478, 322, 433, 5791, 1306, 1481])  # short ones add up
def test_every_purpose_gets_its_part_of_trajectories_of_any_length(lengths: list[int]) -> None:
    purposes, rule = split_rows(lengths, DT_S, CONFIG)
    smallest = counts(purposes).min()
    if "whole" in rule:
        assert smallest >= 0.5 * sum(lengths) / 3
    else:
        # no less than the largest part, but for a block and for what is purged of the log that makes it larger
        assert smallest >= counts(purposes).max() - 1.5 * 1200 - CONFIG.purge_s / DT_S


@pytest.mark.parametrize("n_blocks", [1, 2])
def test_the_turn_goes_on_from_log_to_log(n_blocks: int) -> None:
    purposes, _ = split_rows([1200 * n_blocks] * 5, DT_S, CONFIG)
    first = [int(rows[0]) for rows in purposes[:3]]
    assert sorted(first) == [1, 2, 3]
