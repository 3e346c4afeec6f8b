"""Clocks that are unset, offset or named by the machine's configuration; rows against NumPy's own interpolation."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.logs.trajectories import make_trajectories
from pipeline.machine.log_sources import ClockChoice, CommandSource, CommandSourceKind, JointStateSource
from pipeline.machine.specification import MachineSpecification
from tests.logs.conftest import Session, make_session
from tests.logs.samples import foreign_bags as foreign

SECOND = 1_000_000_000


@pytest.fixture
def one(machine) -> Session:
    return make_session(machine, seconds=12)


@pytest.fixture
def make(machine, config, loop_tracker, tmp_path):
    """Write a session as a bag, read it for a machine, and return its trajectories."""

    def made(session: Session, machine: MachineSpecification = machine):
        path = tmp_path / f"bag{len(list(tmp_path.iterdir()))}"
        session.write(path, machine)
        (entry,) = find_logs(path)
        return make_trajectories(read_log(entry, machine), machine, config, loop_tracker)

    return made


def assert_rows(result, stamp_ns, q, command_ns, command):
    """Every row is the interpolation of the samples, and holds the last command at or before it."""
    (rows,) = result.trajectories
    start = int(stamp_ns[stamp_ns >= command_ns[0]][0])
    np.testing.assert_array_equal(rows.stamp_ns, np.arange(start, stamp_ns[-1] + 1, 50_000_000))
    for joint in range(q.shape[1]):
        at, sampled = (rows.stamp_ns - start).astype(float), (stamp_ns - start).astype(float)
        np.testing.assert_allclose(rows.q[:, joint], np.interp(at, sampled, q[:, joint]), rtol=0, atol=1e-12)
    in_force = [int(np.flatnonzero(command_ns <= stamp)[-1]) for stamp in rows.stamp_ns]
    np.testing.assert_array_equal(rows.a, command[in_force])


def warnings_of(result) -> list[str]:
    return [note.text for note in result.notes if note.kind is NoteKind.warning]


def test_an_offset_above_a_period_is_a_warning_that_says_what_to_do(one, make):
    (text,) = warnings_of(make(replace(one, stamp_ns=one.stamp_ns - 5 * SECOND)))
    assert "the times of /joint_states are 5.00" in text and "s before those of /joint_commands" in text
    assert all(
        key in text for key in ("joint_states.clock", "clock_offset_s", "conf/machine/bobcat_e10.yaml")
    )


@pytest.mark.parametrize(("by_s", "warns"), [(-0.045, False), (-0.06, True), (0.06, True)])
def test_the_warning_begins_at_one_period(one, make, by_s, warns):
    stamp = one.log_time_ns + round(by_s * SECOND)
    assert bool(warnings_of(make(replace(one, stamp_ns=stamp)))) == warns


def test_a_stated_offset_gives_the_rows_of_the_log_without_it(one, make, machine):
    shifted = replace(one, stamp_ns=one.stamp_ns - 5 * SECOND)
    result = make(shifted, replace(machine, joint_states=JointStateSource(clock_offset_s=5.0)))
    assert_rows(result, one.stamp_ns, one.q, one.command_ns, one.command)
    assert warnings_of(result) == [] and abs(result.clock.offset_s) < 0.05


def test_an_offset_of_years_is_allowed(one, make, machine):
    shifted = replace(one, stamp_ns=one.stamp_ns - one.stamp_ns[0] // SECOND * SECOND)
    offset_s = float(one.stamp_ns[0] // SECOND)
    result = make(shifted, replace(machine, joint_states=JointStateSource(clock_offset_s=offset_s)))
    assert_rows(result, one.stamp_ns, one.q, one.command_ns, one.command)


def test_joint_states_by_log_time(one, make, machine):
    shifted = replace(one, stamp_ns=one.stamp_ns - 5 * SECOND)
    result = make(
        shifted,
        replace(machine, joint_states=JointStateSource(clock=ClockChoice.log_time, clock_offset_s=0.25)),
    )
    assert_rows(result, one.log_time_ns + SECOND // 4, one.q, one.command_ns, one.command)
    assert warnings_of(result) == [] and not any("timed by log time" in note.text for note in result.notes)


def test_an_offset_of_the_commands(one, make, machine):
    late = replace(one, command_ns=one.command_ns + 2 * SECOND)
    result = make(late, replace(machine, commands=CommandSource(clock_offset_s=-2.0)))
    assert_rows(result, one.stamp_ns, one.q, one.command_ns, one.command)


@pytest.mark.parametrize(("stated_s", "warns"), [(-5.0, False), (5.0, False), (-3.0, True)])
def test_an_offset_of_the_commands_that_makes_the_clocks_agree_ends_the_warning(
    one, make, machine, stated_s, warns
):
    early = replace(one, stamp_ns=one.stamp_ns + round(np.sign(stated_s)) * 5 * SECOND)
    result = make(early, replace(machine, commands=CommandSource(clock_offset_s=stated_s)))
    assert bool(warnings_of(result)) == warns


def test_a_stated_offset_that_is_not_used_is_told(one, make, machine):
    early = replace(one, stamp_ns=one.stamp_ns - 8 * SECOND)
    result = make(early, replace(machine, joint_states=JointStateSource(clock_offset_s=-8.0)))
    assert any("the stated clock_offset_s of -8 s is not used" in note.text for note in result.notes)


def test_commands_by_their_header_stamps(one, machine, config, loop_tracker, tmp_path):
    """A `JointState` of commands that the recorder got 0.3 s late; both streams are stamped by another clock."""
    source = CommandSource(
        source=CommandSourceKind.joint_state, field_name="velocity", clock=ClockChoice.header_stamp
    )
    stamped = replace(machine, commands=source, joint_states=JointStateSource(clock=ClockChoice.header_stamp))
    old = one.stamp_ns[0] // SECOND * SECOND - 100 * SECOND  # both clocks count from 100 s on
    stamps, given = one.stamp_ns - old, one.command_ns - old
    names, still = machine.joint_names, np.zeros(machine.n_joint)
    states = [
        (int(log), "/joint_states", foreign.joint_state(foreign.ROS2, stamp, names, q))
        for log, stamp, q in zip(one.log_time_ns, stamps, one.q, strict=True)
    ]
    orders = [
        (int(log) + 300_000_000, "/joint_commands", foreign.joint_state(foreign.ROS2, stamp, names, still, a))
        for log, stamp, a in zip(one.command_ns, given, one.command, strict=True)
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(states + orders, key=lambda message: message[0]))
    (entry,) = find_logs(tmp_path)
    result = make_trajectories(read_log(entry, stamped), stamped, config, loop_tracker)
    assert_rows(result, stamps, one.q, given, one.command)
    assert 0 <= result.trajectories[0].t_s[0] < 0.1
    assert warnings_of(result) == []


def test_one_unset_stamp_costs_its_sample_only(one, make):
    stamp_ns = one.stamp_ns.copy()
    stamp_ns[[0, 300]] = 0
    result = make(replace(one, stamp_ns=stamp_ns))
    kept = stamp_ns != 0
    assert_rows(result, stamp_ns[kept], one.q[kept], one.command_ns, one.command)
    assert ("joint samples: their header stamp is zero", 2) in [
        (note.text, note.count) for note in result.notes
    ]
    assert abs(result.clock.offset_p99_s) < 0.01


def test_messages_before_the_recorders_clock_had_started(one, make):
    """A recorder on simulated time: the first messages have log time 0."""
    log_time_ns, command_ns = one.log_time_ns.copy(), one.command_ns.copy()
    log_time_ns[:3] = command_ns[:2] = 0
    result = make(replace(one, log_time_ns=log_time_ns, command_ns=command_ns))
    assert_rows(result, one.stamp_ns, one.q, command_ns, one.command)
    assert abs(result.trajectories[0].t_s[0]) < 0.1
    assert any(
        note.text.startswith("commands: their log time is zero") and note.count == 2 for note in result.notes
    )


def test_commands_that_all_lack_a_time_are_refused(one, make):
    with pytest.raises(InputError, match=r"the log time of all 240 commands is zero; set commands\.clock"):
        make(replace(one, command_ns=np.zeros_like(one.command_ns)))


def test_a_clock_that_begins_at_zero_is_set(one, make):
    start = min(int(one.stamp_ns[0]), int(one.command_ns[0]))
    moved = replace(
        one,
        stamp_ns=one.stamp_ns - start,
        log_time_ns=one.log_time_ns - start,
        command_ns=one.command_ns - start,
    )
    result = make(moved)
    assert_rows(result, moved.stamp_ns, one.q, moved.command_ns, one.command)
    assert not any("zero" in note.text for note in result.notes)


def test_automatic_is_no_clock_of_commands():
    with pytest.raises(InputError, match=r"commands\.clock is automatic"):
        CommandSource(clock=ClockChoice.automatic)


@pytest.mark.parametrize("offset_s", [1e10, float("nan")])
def test_an_offset_that_no_clock_has_is_refused(offset_s):
    with pytest.raises(InputError, match=r"joint_states\.clock_offset_s"):
        JointStateSource(clock_offset_s=offset_s)


def test_positions_that_no_joint_has_are_told_without_overflow(one, make, recwarn):
    q = one.q.copy()
    q[100:103, 1] = (1e308, -1e308, 1e308)
    q[200, 2] = 1e-320
    result = make(replace(one, q=q))
    assert ("joint samples: the position of boom is beyond 1e+06 rad", 3) in [
        (note.text, note.count) for note in result.notes
    ]
    q[:, 1] = 1e308
    with pytest.raises(
        InputError, match=r"none holds a position .* the position of boom is beyond 1e\+06 rad"
    ):
        make(replace(one, q=q))
    assert not recwarn.list
