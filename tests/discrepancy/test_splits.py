"""Purposes of rows: no row has two, purges lie between, every purpose gets its share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.discrepancy.splits import Purpose, SplitConfig, split_rows

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
