"""Where a log is cut into sections, and whether its columns lie in memory or on disk, makes no difference."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.logs.conditioning.excitation import Excitation
from pipeline.logs.conditioning.order_statistics import quantiles
from pipeline.logs.messages.columns import DiskStore, MemoryStore, as_array, extent, sections
from pipeline.logs.messages.raw_log import RawLog
from pipeline.logs.quality import measure
from pipeline.logs.trajectories import grid_log, make_trajectories, trajectory_sections
from tests.logs.conftest import make_session

relaxed = settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@st.composite
def faulty_logs(draw, machine):
    """A session with faults of every kind that conditioning knows."""
    session = make_session(machine, seconds=draw(st.sampled_from([3, 8])), seed=draw(st.integers(0, 3)))
    q, stamp, log_time = session.q.copy(), session.stamp_ns.copy(), session.log_time_ns.copy()
    command_ns, command = session.command_ns.copy(), session.command.copy()
    row, joint = st.integers(0, len(q) - 1), st.integers(0, machine.n_joint - 1)
    for fault in draw(st.lists(st.sampled_from("nsjgdroxcwzlb"), max_size=5)):
        at = draw(row)
        match fault:
            case "n":
                q[at, draw(joint)] = np.nan
            case "s":
                q[at, draw(joint)] += draw(st.sampled_from([-9.0, 2.0]))
            case "j":
                q[at:, draw(joint)] += draw(st.sampled_from([-3.0, 2.0]))
            case "g":
                stamp[at:] += 700_000_000
                log_time[at:] += 700_000_000
            case "d":
                stamp[at] = stamp[at - 1]
            case "r":
                stamp[max(at - 3, 0) : at] = stamp[max(at - 3, 0) : at][::-1]
            case "o":
                stamp[at] += draw(st.sampled_from([-(10**11), 10**11]))
            case "x":
                command[draw(st.integers(0, len(command) - 1)), draw(joint)] = 3.0
            case "c":
                early = draw(st.integers(1, len(command_ns) - 1))
                command_ns[early] -= 300_000_000
            case "w":
                q[:, draw(joint)] %= 2 * np.pi
            case "z":
                stamp[at:] -= 60_000_000_000
                log_time[at:] -= 60_000_000_000
                command_ns[len(command_ns) * at // len(q) :] -= 60_000_000_000
            case "l":
                q[:, draw(joint)] += 0.7
            case "b":
                q[at : at + 120, draw(joint)] = 0.1
    return RawLog("bag", Path("bag"), stamp, log_time, q, command_ns, command)


def processed(raw, machine, config, loop_tracker, store, section_rows):
    """Everything that ingest makes of a log: trajectories and report, or the refusal."""
    try:
        gridded = grid_log(raw, machine, config, store, section_rows)
    except InputError as error:
        return str(error)
    excitation, trajectories = Excitation(machine, 0.5), {}
    for part in trajectory_sections(gridded, machine, config, loop_tracker, section_rows):
        excitation.add(part)
        trajectories.setdefault(part.name, []).append(part)
    excitation.end_trajectory()
    rows = {
        name: [np.concatenate([getattr(part, field) for part in parts]).tobytes() for field in FIELDS]
        for name, parts in trajectories.items()
    }
    return rows, measure(raw, gridded, excitation, 0, machine, config)


FIELDS = ("t_s", "stamp_ns", "q", "qd", "a", "is_validation")


@relaxed
@given(data=st.data())
def test_any_cut_gives_the_same_tuples_and_the_same_report(data, machine, config, loop_tracker, tmp_path):
    raw = data.draw(faulty_logs(machine))
    expected = processed(raw, machine, config, loop_tracker, MemoryStore(), 10**9)
    section_rows = data.draw(st.integers(1, 300))
    with DiskStore(tmp_path / "scratch") as store:
        cut = processed(raw, machine, config, loop_tracker, store, section_rows)
    assert not (tmp_path / "scratch").exists()
    if isinstance(expected, str):
        assert cut == expected
        return
    assert cut[0] == expected[0]
    assert sorted(map(str, cut[1].notes)) == sorted(map(str, expected[1].notes))
    assert cut[1].findings == expected[1].findings
    for name, value in expected[1].metrics.items():
        assert cut[1].metrics[name] == (value if value is None else pytest.approx(value, rel=1e-9)), name


def test_faults_occur_that_split_and_refuse(machine, config, loop_tracker):
    """The property above would hold of logs without faults too: these kinds are really met by it."""
    seen = set()

    @settings(deadline=None, max_examples=80, derandomize=True, database=None)
    @given(raw=faulty_logs(machine))
    def collect(raw):
        try:
            result = make_trajectories(raw, machine, config, loop_tracker)
        except InputError as error:
            seen.add(str(error)[:30])
            return
        seen.update(note.text.split(":")[0][:24] for note in result.notes)

    collect()
    assert len(seen) >= 10, seen


def test_late_samples_are_left_out_and_counted(machine, config, loop_tracker):
    """Steps back of less than a gap each may add up; what is older than the window is not waited for."""
    session = make_session(machine, seconds=6)
    backwards = [81, 62, 43, 24]  # 0.36 s and three times 0.38 s back, after sample 99
    others = [row for row in range(300) if row not in backwards]

    def log_of(rows):
        samples = (column[rows] for column in (session.stamp_ns, session.log_time_ns, session.q))
        return RawLog("bag", Path("bag"), *samples, session.command_ns, session.command)

    result = make_trajectories(log_of(others[:96] + backwards + others[96:]), machine, config, loop_tracker)
    (note,) = [note for note in result.notes if "older than one before" in note.text]
    assert note.count == 3
    clean = make_trajectories(log_of(sorted([*others, 81])), machine, config, loop_tracker)
    np.testing.assert_array_equal(result.trajectories[0].q, clean.trajectories[0].q)


@relaxed
@given(
    st.lists(st.lists(st.one_of(st.integers(-5, 5), st.integers(-(2**50), 2**50))), min_size=1),
    st.lists(st.floats(0, 1), min_size=1, max_size=3),
)
def test_quantiles_are_numpys(monkeypatch, parts, fractions):
    monkeypatch.setattr("pipeline.logs.conditioning.order_statistics.SORTED_AT_ONCE", 3)
    monkeypatch.setattr("pipeline.logs.conditioning.order_statistics.N_BINS", 4)
    arrays = [np.array(part, np.int64) for part in parts]
    values = np.concatenate(arrays).astype(float)
    if not len(values):
        with pytest.raises(ValueError, match="no values"):
            quantiles(lambda: arrays, fractions)
        return
    expected = np.quantile(values, fractions)
    np.testing.assert_allclose(quantiles(lambda: arrays, fractions), expected, rtol=1e-12, atol=1e-9)


def test_quantiles_of_many_values():
    values = np.random.default_rng(0).normal(size=300_000)
    parts = np.array_split(values, 7)
    fractions = [0.0, 0.01, 0.16, 0.5, 0.84, 1.0]
    np.testing.assert_allclose(
        quantiles(lambda: parts, fractions), np.quantile(values, fractions), rtol=1e-13
    )


@relaxed
@given(st.lists(st.integers(0, 30), min_size=1, max_size=6), st.integers(1, 40))
def test_stores_agree(tmp_path, lengths, n_rows):
    rng = np.random.default_rng(1)
    blocks = [
        {"time": rng.integers(0, 99, n), "q": rng.normal(size=(n, 3)), "f": rng.random(n).astype("f4")}
        for n in lengths
    ]
    memory = MemoryStore()
    with DiskStore(tmp_path / "s") as disk:
        for block in blocks:
            memory.append("table", block)
            disk.append("table", block)
        assert disk.columns("another") == memory.columns("another") == {}
        ours, theirs = disk.columns("table"), memory.columns("table")
        for name, expected in theirs.items():
            joined = np.concatenate(
                [part for (part,) in sections((ours[name],), n_rows=n_rows)] or [expected]
            )
            np.testing.assert_array_equal(joined, expected)
            np.testing.assert_array_equal(as_array(ours[name]), expected)
            np.testing.assert_array_equal(ours[name][2:5], expected[2:5])
            assert len(ours[name]) == len(expected)
        if sum(lengths):
            assert extent(ours["time"]) == (theirs["time"].min(), theirs["time"].max())


def test_sections_follow_each_other():
    column = np.arange(10)
    parts = [part.tolist() for (part,) in sections((column,), 2, 9, 3)]
    assert parts == [[2, 3, 4], [5, 6, 7], [8]]
    assert list(itertools.chain(*parts)) == list(range(2, 9))
