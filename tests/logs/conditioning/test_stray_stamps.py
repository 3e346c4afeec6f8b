"""Stray stamps: which samples they cost, whatever the sections."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps

SECOND = 1_000_000_000
GAP_NS = SECOND // 2
PERIOD_NS = SECOND // 20
STEADY = 1_700_000_000 * SECOND + np.arange(200) * PERIOD_NS


def rows_left(time_ns, section_rows=1000):
    """The rows that are left of a stream, and how many are told."""
    rows, notes = np.arange(len(time_ns)), []
    stream = (
        Samples(time_ns[first : first + section_rows], rows[first : first + section_rows])
        for first in range(0, len(time_ns), section_rows)
    )
    left = [section.value for section in drop_stray_stamps(stream, GAP_NS, "samples", "time", notes)]
    return np.concatenate(left), sum(note.count for note in notes)


@pytest.mark.parametrize("n", range(1, 9))
@pytest.mark.parametrize("by_s", [-3600, 3600])
@pytest.mark.parametrize("is_each_its_own", [False, True])
def test_a_run_costs_its_samples_only(n, by_s, is_each_its_own):
    time_ns = STEADY.copy()
    time_ns[100 : 100 + n] += by_s * SECOND * (np.arange(1, n + 1) if is_each_its_own else 1)
    left, n_told = rows_left(time_ns)
    np.testing.assert_array_equal(left, np.delete(np.arange(200), slice(100, 100 + n)))
    assert n_told == n


@pytest.mark.parametrize("n", [2, 3, 20])
def test_a_block_that_is_stored_elsewhere_is_not_stray(n):
    """No time passes between the samples before and after it."""
    time_ns = np.insert(STEADY, 100, STEADY[-1] + 60 * SECOND + np.arange(n) * PERIOD_NS)
    assert rows_left(time_ns)[1] == 0


@settings(deadline=None, max_examples=200)
@given(
    steps=st.lists(st.sampled_from([0.05, 0.05, 0.05, 0.3, 0.7, -0.2, 40.0, -40.0]), min_size=1, max_size=60),
    section_rows=st.integers(1, 20),
)
def test_sections_make_no_difference(steps, section_rows):
    time_ns = np.cumsum(np.array(steps) * SECOND).astype(np.int64)
    expected, n_told = rows_left(time_ns)
    found, n_found = rows_left(time_ns, section_rows)
    np.testing.assert_array_equal(found, expected)
    assert n_found == n_told == len(steps) - len(expected)
