import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.logs.conditioning.command_rules import HeldCommands
from pipeline.logs.conditioning.resample import GridRows, resample
from pipeline.logs.conditioning.samples import Samples

MS = 1_000_000


def stream(time_ms, values, cuts=()):
    samples = Samples(np.array(time_ms, np.int64) * MS, np.array(values, float)[:, None])
    bounds = [0, *sorted(cuts), len(samples)]
    return [samples[begin:end] for begin, end in itertools.pairwise(bounds)]


def grid(joint_ms, q, command_ms, command, gap_s=0.5, cuts=(), command_cuts=()):
    """The grid's segments, each joined from the sections that it came in."""
    commands = HeldCommands(stream(command_ms, command, command_cuts))
    rows = list(resample(stream(joint_ms, q, cuts), commands, 0.05, gap_s, []))
    segments = []
    for _, parts in itertools.groupby(rows, lambda part: part.segment):
        parts = list(parts)
        joined = (np.concatenate([getattr(p, name) for p in parts]) for name in ("stamp_ns", "q", "a"))
        segments.append(GridRows(parts[0].segment, *joined))
    return segments


def test_grid_starts_at_first_sample_after_first_command():
    (segment,) = grid([0, 30, 60, 90, 120, 150], [0, 3, 6, 9, 12, 15], [40, 100], [1, -1])
    np.testing.assert_array_equal(segment.stamp_ns, np.array([60, 110]) * MS)
    np.testing.assert_allclose(segment.q[:, 0], [6.0, 11.0])
    np.testing.assert_array_equal(segment.a[:, 0], [1, -1])


def test_commands_are_causal():
    """A command takes effect at the first row at or after it, never before."""
    (segment,) = grid([0, 50, 100, 150], [0, 0, 0, 0], [0, 99, 100, 101], [0, 1, -1, 0.5])
    np.testing.assert_array_equal(segment.a[:, 0], [0, 0, -1, 0.5])


def test_gaps_split_and_longest_allowed_gap_does_not():
    segments = grid([0, 50, 550, 600, 1101, 1151], [0, 1, 11, 12, 0, 1], [0], [1])
    assert [len(segment.stamp_ns) for segment in segments] == [13, 2]
    np.testing.assert_array_equal(segments[1].stamp_ns, np.array([1101, 1151]) * MS)
    np.testing.assert_allclose(segments[0].q[:, 0], np.arange(13))  # the gap of 500 ms is interpolated


def test_nothing_without_commands_or_without_samples_after_them():
    assert grid([0, 50], [0, 1], [], []) == []
    assert grid([0, 50], [0, 1], [60], [1]) == []


@given(st.data())
def test_against_a_row_by_row_reference(data):
    n, m = data.draw(st.integers(2, 40)), data.draw(st.integers(1, 20))
    joint = np.cumsum(data.draw(st.lists(st.integers(1, 120), min_size=n, max_size=n)))
    command = np.cumsum(data.draw(st.lists(st.integers(0, 120), min_size=m, max_size=m)))
    q = np.array(data.draw(st.lists(st.floats(-5, 5), min_size=n, max_size=n)))
    a = np.arange(m) * 1.0
    rows = []
    inside = [i for i in range(n) if joint[i] >= command[0]]
    if inside:
        t = joint[inside[0]]
        while t <= joint[-1]:
            right = next(i for i in range(n) if joint[i] >= t)
            left = right if joint[right] == t else right - 1
            share = 0.0 if right == left else (t - joint[left]) / (joint[right] - joint[left])
            rows.append(
                (t, (1 - share) * q[left] + share * q[right], max(i for i in range(m) if command[i] <= t))
            )
            t += 50
    cuts, command_cuts = (data.draw(st.lists(st.integers(0, k), max_size=4)) for k in (n, m))
    segments = grid(joint, q, command, a, cuts=cuts, command_cuts=command_cuts)
    got = [row for s in segments for row in zip(s.stamp_ns // MS, s.q[:, 0], s.a[:, 0], strict=True)]
    assert len(got) == len(rows)
    np.testing.assert_allclose(
        np.array(got, float).reshape(-1, 3), np.array(rows, float).reshape(-1, 3), atol=1e-9
    )
