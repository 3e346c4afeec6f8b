"""One session, written in all kinds of logs, gives the same tuples."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars
import pytest
from rosbags.rosbag2 import StoragePlugin

from pipeline.logs.export.lerobot import write_lerobot
from pipeline.logs.trajectories import load_trajectories
from pipeline.logs.tuples import Trajectory
from tests.logs.conftest import make_session
from tests.logs.samples import can_logs, self_describing_bags
from tests.logs.samples import foreign_bags as foreign

START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Kind:
    """A kind of log.

    Attributes:
        write: Writes the session into a folder.
        time_s: Its resolution of times.
        q: Its resolution of positions, relative to their size, or absolute.
    """

    write: object
    time_s: float = 0.0
    q_relative: float = 0.0
    q_absolute: float = 0.0


def write_ros2(storage):
    def write(folder, session, machine):
        foreign.write_rosbag2(
            folder / "a", foreign.messages(foreign.ROS2, session, machine.joint_names), storage
        )

    return write


def write_ros1(folder, session, machine):
    foreign.write_rosbag1(folder / "a.bag", foreign.messages(foreign.ROS1, session, machine.joint_names))


def write_tables(suffix):
    def write(folder, session, machine):
        q = {f"q_{joint}": session.q[:, i] for i, joint in enumerate(machine.joint_names)}
        a = {f"a_{joint}": session.command[:, i] for i, joint in enumerate(machine.joint_names)}
        parts = [
            polars.DataFrame({"t": session.stamp_ns, **q}),
            polars.DataFrame({"t": session.command_ns, **a}),
        ]
        getattr(polars.concat(parts, how="diagonal").sort("t"), f"write_{suffix}")(folder / f"a.{suffix}")

    return write


def write_mcap(encoding):
    def write(folder, session, machine):
        self_describing_bags.write(folder / "a.mcap", encoding, session, machine.joint_names)

    return write


def write_can(suffix):
    def write(folder, session, machine):
        can_logs.write(folder / f"a{suffix}", can_logs.frames(session, machine.joint_names))

    return write


def write_dataset(folder, session, machine):
    """At the rate of the joint samples, each with the command in force."""
    in_force = np.searchsorted(session.command_ns, session.stamp_ns, side="right") - 1
    rows = slice(int((in_force < 0).sum()), None)  # LeRobot has no frames without an action
    columns = (session.stamp_ns[rows], session.q[rows], session.q[rows], session.command[in_force[rows]])
    episode = Trajectory("a", columns[0] / 1e9, *columns, np.zeros(len(columns[0]), bool))
    write_lerobot(folder / "a", replace(machine, rate_hz=50.0), [episode], "dig")


HALF_A_BIT = 2.0**-24  # of float32
CAN_Q = can_logs.POSITION_RESOLUTION_RAD / 2
KINDS = {
    "ROS 2, SQLite": Kind(write_ros2(StoragePlugin.SQLITE3)),
    "ROS 2, MCAP": Kind(write_ros2(StoragePlugin.MCAP)),
    "MCAP, JSON": Kind(write_mcap("json")),
    "MCAP, Protobuf": Kind(write_mcap("protobuf")),
    "ROS 1": Kind(write_ros1),
    "CSV": Kind(write_tables("csv")),
    "Parquet": Kind(write_tables("parquet")),
    "LeRobot": Kind(write_dataset, q_relative=HALF_A_BIT),
    **{
        f"CAN, {suffix}": Kind(write_can(suffix), time_s=resolution, q_absolute=CAN_Q)
        for suffix, resolution in can_logs.RESOLUTION_S.items()
    },
}


@pytest.fixture(scope="module")
def session(machine):
    """Joint samples at 50 Hz on whole milliseconds; commands between them, so that no row is at a command's edge."""
    made = make_session(machine, seconds=12)
    steps = np.arange(len(made.q))
    stamp_ns = START_NS + 20_000_000 * steps
    command_ns = START_NS + 3_000_000 + 50_000_000 * np.arange(len(made.command))
    return replace(made, stamp_ns=stamp_ns, log_time_ns=stamp_ns + 1_000_000, command_ns=command_ns)


@pytest.fixture(scope="module")
def expected(machine, session, config, loop_tracker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("expected")
    session.write(folder / "a", machine)
    (trajectory,) = load_trajectories(folder, machine, config, loop_tracker)
    return trajectory


@pytest.mark.parametrize("name", KINDS)
def test_the_same_tuples(tmp_path: Path, machine, session, expected, config, loop_tracker, name):
    kind = KINDS[name]
    kind.write(tmp_path, session, machine)
    described = replace(machine, columns=replace(machine.columns, time_unit="ns"))
    (found,) = load_trajectories(tmp_path, described, config, loop_tracker)
    n = len(found)
    assert abs(n - len(expected)) <= (
        kind.time_s > 0
    )  # the first sample may lie before the first command, or the last
    n = min(n, len(expected))
    speed = np.abs(np.diff(session.q, axis=0)).max(axis=0) / 0.02
    bound = kind.q_absolute + kind.q_relative * np.abs(expected.q[:n]) + kind.time_s * speed + 1e-15
    exact = kind.time_s == 0
    assert (np.abs(found.q[:n] - expected.q[:n]) <= (0 if exact and not kind.q_relative else bound)).all()
    np.testing.assert_array_equal(found.a[:n], expected.a[:n])
    times = found.stamp_ns[:n] - expected.stamp_ns[:n]
    if exact:
        np.testing.assert_array_equal(times, 0)
        if not kind.q_relative:
            np.testing.assert_array_equal(found.qd, expected.qd)
    else:  # a format may begin at another zero
        assert np.ptp(times) <= 2e9 * kind.time_s
