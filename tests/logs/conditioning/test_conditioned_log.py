"""Faults put into a clean log by hand; each must be found, counted and handled by its rule."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.logs.conditioning.clocks import HEADER_STAMP, LOG_TIME, choose_clock
from pipeline.logs.conditioning.conditioned_log import ConditionedLog
from pipeline.logs.conditioning.samples import join
from pipeline.logs.messages.columns import MemoryStore
from pipeline.logs.messages.raw_log import NoteKind, RawLog
from pipeline.logs.trajectories import make_trajectories
from tests.logs.conftest import make_session

SECOND = 1_000_000_000


@pytest.fixture
def raw(machine) -> RawLog:
    session = make_session(machine, seconds=20)
    return RawLog(
        "bag",
        Path("bag"),
        session.stamp_ns.copy(),
        session.log_time_ns.copy(),
        session.q.copy(),
        session.command_ns.copy(),
        session.command.copy(),
    )


@pytest.fixture
def make(machine, config, loop_tracker):
    return lambda raw: make_trajectories(raw, machine, config, loop_tracker)


def noted(result, words):
    """Count of the one note that holds the words."""
    (note,) = [note for note in result.notes if words in note.text]
    return note.count


def test_clean_log_has_one_trajectory_and_no_loss(raw, make, machine):
    result = make(raw)
    (trajectory,) = result.trajectories
    assert {note.text for note in result.notes} <= {"joint samples before the first command"}
    inside = raw.joint_stamp_ns[raw.joint_stamp_ns >= raw.command_log_time_ns[0]]
    assert trajectory.stamp_ns[0] == inside[0]
    assert len(trajectory) == (inside[-1] - inside[0]) // 50_000_000 + 1
    start = min(raw.joint_log_time_ns[0], raw.command_log_time_ns[0])
    np.testing.assert_allclose(trajectory.t_s, (trajectory.stamp_ns - start) / 1e9, rtol=0, atol=1e-12)
    assert trajectory.is_validation.sum() == round(0.1 * len(trajectory)) and trajectory.is_validation[-1]


def test_gap_splits_and_names_the_pieces(raw, make):
    keep = np.r_[0:400, 440:1000]
    cut = replace(
        raw,
        joint_stamp_ns=raw.joint_stamp_ns[keep],
        joint_log_time_ns=raw.joint_log_time_ns[keep],
        q=raw.q[keep],
    )
    result = make(cut)
    assert [trajectory.name for trajectory in result.trajectories] == ["bag", "bag#1"]
    assert result.trajectories[1].stamp_ns[0] == raw.joint_stamp_ns[440]
    assert noted(result, "split into 2 trajectories") == 1


def test_not_a_number_is_left_out(raw, make):
    raw.q[100:103, 2] = np.nan
    raw.q[200, 0] = np.inf
    result = make(raw)
    assert noted(result, "position of arm is not a number") == 3
    assert noted(result, "position of swing is not a number") == 1
    assert np.isfinite(result.trajectories[0].q).all()


def test_spike_is_left_out_and_lasting_jump_splits(raw, make):
    clean = make(raw).trajectories[0]
    raw.q[300, 1] += 0.9
    result = make(raw)
    assert noted(result, "position of boom is a spike") == 1
    assert np.abs(result.trajectories[0].q - clean.q).max() < 0.01
    raw.q[600:, 3] += 0.8
    result = make(raw)
    assert noted(result, "encoder jumps") == 1
    assert [trajectory.name for trajectory in result.trajectories] == ["bag", "bag#1"]


def test_wrap_around_is_unwrapped(raw, make, machine):
    """An encoder that reads 0 to 2π: negative angles stand a turn higher."""
    expected = make(raw).trajectories[0].q
    raw.q[:, 2] %= 2 * np.pi
    raw.q[:, 0] %= 2 * np.pi
    result = make(raw)
    np.testing.assert_allclose(result.trajectories[0].q, expected, atol=1e-9)
    assert "whole turns" in next(note.text for note in result.notes if "encoder of arm" in note.text)
    assert noted(result, "encoder of swing") >= 1


def test_duplicates_and_reordering(raw, make):
    expected = make(raw).trajectories[0]
    order = np.r_[0:100, 101, 100, 102:1000, 999, 999]
    raw = replace(
        raw,
        joint_stamp_ns=raw.joint_stamp_ns[order],
        joint_log_time_ns=raw.joint_log_time_ns[order],
        q=raw.q[order],
    )
    result = make(raw)
    assert noted(result, "out of order by header stamp") == 1
    assert noted(result, "header stamp repeats") == 2
    np.testing.assert_array_equal(result.trajectories[0].q, expected.q)


def test_damaged_stamp_costs_its_sample_only(raw, make):
    raw.joint_stamp_ns[500] += 3_000 * SECOND
    raw.joint_stamp_ns[700] = 12 * SECOND
    result = make(raw)
    assert noted(result, "lies far from both neighbours") == 2
    assert len(result.trajectories) == 1


def test_clock_step_back_of_both_clocks_splits(raw, make):
    """The recorder's clock was set back by a minute: two stretches that overlap in time, each with its commands."""
    raw.joint_stamp_ns[500:] -= 60 * SECOND
    raw.joint_log_time_ns[500:] -= 60 * SECOND
    raw.command_log_time_ns[200:] -= 60 * SECOND
    raw.command[:200], raw.command[200:] = -1, 1
    result = make(raw)
    assert noted(result, "the clock steps back") == 1
    assert [set(trajectory.a.ravel()) for trajectory in result.trajectories] == [{-1.0}, {1.0}]


def step_samples(raw):
    raw.joint_stamp_ns[500:] -= 60 * SECOND
    raw.joint_log_time_ns[500:] -= 60 * SECOND


def step_commands(raw):
    raw.command_log_time_ns[200:] -= 60 * SECOND


@pytest.mark.parametrize("step", [step_samples, step_commands])
def test_clock_step_of_one_stream_alone_is_refused(raw, make, step):
    step(raw)
    with pytest.raises(InputError, match="split the bag at the steps"):
        make(raw)


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("by_s", [-100, 100])
def test_damaged_times_cost_their_own_messages_only(raw, make, by_s, n):
    expected = make(raw).trajectories[0]
    raw.command_log_time_ns[200 : 200 + n] += by_s * SECOND
    raw.joint_log_time_ns[300 : 300 + n] += by_s * SECOND
    result = make(raw)
    assert noted(result, "commands: their log time lies far from both neighbours'") == n
    (trajectory,) = result.trajectories
    np.testing.assert_array_equal(trajectory.t_s, expected.t_s)
    np.testing.assert_array_equal(trajectory.q, expected.q)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda raw: raw.joint_stamp_ns.fill(0), "header stamps are zero"),
        (lambda raw: raw.joint_stamp_ns.fill(5), "all header stamps are alike"),
        (lambda raw: np.subtract(raw.joint_stamp_ns, 10**17, out=raw.joint_stamp_ns), "of another clock"),
        (lambda raw: raw.joint_stamp_ns[500:].__isub__(5 * SECOND), "clock steps back"),
    ],
)
def test_log_time_takes_the_place_of_useless_stamps(raw, make, spoil, words):
    spoil(raw)
    result = make(raw)
    assert result.clock.used == LOG_TIME and words in result.clock.reason
    assert noted(result, "timed by log time") == len(raw.q)
    assert result.trajectories[0].stamp_ns[0] in raw.joint_log_time_ns


@given(offset_ms=st.floats(-400, 400), drift=st.floats(-80, 80))
def test_offset_and_drift_are_measured_not_removed(offset_ms, drift):
    rng = np.random.default_rng(0)
    stamp = 10**18 + np.arange(30_000, dtype=np.int64) * 20_000_000
    elapsed = (stamp - stamp[0]).astype(float)
    log_time = stamp + (offset_ms * 1e6 + drift * 1e-6 * elapsed + rng.uniform(0, 1e6, len(stamp))).astype(
        np.int64
    )
    empty = np.zeros((0, 1))
    raw = RawLog("b", Path("b"), stamp, log_time, np.zeros((len(stamp), 1)), np.zeros(0, np.int64), empty)
    time_ns, report, notes = choose_clock(raw, 0.5, 10.0)
    assert report.used == HEADER_STAMP and notes == [] and time_ns is raw.joint_stamp_ns
    assert abs(report.drift_ppm - drift) < 0.5
    assert abs(report.offset_s - (offset_ms * 1e-3 + 0.5e-3 + drift * 1e-6 * 300)) < 1e-4


def test_one_impossible_command_is_unknown_until_the_next(raw, make):
    raw.command[200, 1] = 5
    result = make(raw)
    assert noted(result, "commands outside {-1, 0, 1} (first 5 for boom") == 1
    from_ns, until_ns = raw.command_log_time_ns[200:202]
    for trajectory in result.trajectories:
        assert not ((trajectory.stamp_ns >= from_ns) & (trajectory.stamp_ns < until_ns)).any()
    rows = sum(len(trajectory) for trajectory in result.trajectories)
    assert rows in (
        len(make(replace(raw, command=np.clip(raw.command, -1, 1))).trajectories[0]) - n for n in (0, 1)
    )


def test_many_impossible_commands_refuse_the_log(raw, make):
    raw.command[3:, 0] = 7
    time_ns = raw.command_log_time_ns[3]
    match = rf"bag: 397 of 400 commands are outside {{-1, 0, 1}}, first 7 for swing at log time {time_ns}"
    with pytest.raises(InputError, match=match):
        make(raw)


def test_continuous_commands(continuous_machine, config, loop_tracker, raw):
    span = continuous_machine.upper - continuous_machine.lower
    raw = replace(
        raw,
        q=continuous_machine.lower + 0.5 * span + 0.0 * raw.q,
        command=raw.command * np.float32(1.0000001),
    )
    raw.command[10, 0] = np.nan
    result = make_trajectories(raw, continuous_machine, config, loop_tracker)
    assert noted(result, "outside [-1, 1] (first nan for swing") == 1
    assert max(np.abs(trajectory.a).max() for trajectory in result.trajectories) == 1.0


def test_values_outside_limits_are_kept_and_counted(raw, make, machine):
    raw.q[:, 0] += 0.5
    n_outside = int((raw.q[:, 0] > machine.upper[0]).sum())
    result = make(raw)
    assert n_outside and noted(result, "swing is outside its limits") == n_outside
    assert result.trajectories[0].q[:, 0].max() > machine.upper[0]


def test_log_without_overlap_of_streams(raw, make):
    with pytest.raises(InputError, match="no trajectory"):
        make(replace(raw, command_log_time_ns=raw.command_log_time_ns + 10**6 * SECOND))


@settings(deadline=None)
@given(st.data())
def test_no_sample_vanishes_without_a_count(machine_and_config, data):
    """Whatever is wrong: samples in = samples used + samples counted as left out."""
    machine, config = machine_and_config
    session = make_session(machine, seconds=4)
    q, stamp = session.q.copy(), session.stamp_ns.copy()
    for _ in range(data.draw(st.integers(0, 5))):
        row, joint = data.draw(st.integers(0, len(q) - 1)), data.draw(st.integers(0, machine.n_joint - 1))
        match data.draw(st.integers(0, 3)):
            case 0:
                q[row, joint] = np.nan
            case 1:
                q[row, joint] += data.draw(st.floats(-10, 10))
            case 2:
                stamp[row] = stamp[data.draw(st.integers(0, len(q) - 1))]
            case 3:
                stamp[row] += data.draw(st.integers(-(10**11), 10**11))
    log = RawLog("b", Path("b"), stamp, session.log_time_ns, q, session.command_ns, session.command)
    try:
        result = ConditionedLog(log, machine, config, MemoryStore(), data.draw(st.integers(1, 100)))
        stretches = [list(parts) for _, parts in itertools.groupby(result.joints, lambda part: part.stretch)]
        result.finish()
    except InputError:
        return
    stretches = [join(parts) for parts in stretches]
    used = sum(len(stretch) for stretch in stretches)
    nan_rows = int((~np.isfinite(q)).any(axis=1).sum())
    left_out = sum(
        note.count
        for note in result.notes
        if note.kind is NoteKind.left_out and "not a number" not in note.text
    )
    # A row with several spiky joints is noted once per joint, so the count may exceed the rows, never fall short.
    assert used + left_out + nan_rows >= len(q) and used <= len(q) - nan_rows
    for stretch in stretches:
        assert (np.diff(stretch.time_ns) > 0).all() and np.isfinite(stretch.value).all()


@pytest.fixture(scope="module")
def machine_and_config(machine, config):
    return machine, config
