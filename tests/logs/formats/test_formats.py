import sqlite3
from pathlib import Path

import numpy as np
import polars
import pytest
from rosbags.rosbag2 import StoragePlugin

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from tests.logs.conftest import load_machine, make_session, shared_folder
from tests.logs.samples import foreign_bags as foreign


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=6)


def assert_holds(raw, session, notes=()):
    np.testing.assert_array_equal(raw.joint_stamp_ns, session.stamp_ns)
    np.testing.assert_array_equal(raw.joint_log_time_ns, session.log_time_ns)
    np.testing.assert_array_equal(raw.q, session.q)
    np.testing.assert_array_equal(raw.command_log_time_ns, session.command_ns)
    np.testing.assert_array_equal(raw.command, session.command)
    assert raw.message_counts == {"/joint_states": len(session.q), "/joint_commands": len(session.command)}
    assert [note.text for note in raw.notes] == list(notes)


def read_only(path: Path, machine):
    (entry,) = find_logs(path)
    return read_log(entry, machine)


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_ros1(tmp_path, machine, short, compression):
    entries = foreign.messages(foreign.ROS1, short, machine.joint_names)
    foreign.write_rosbag1(tmp_path / "a.bag", entries, compression)
    assert_holds(read_only(tmp_path, machine), short)


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_ros2_folder(tmp_path, machine, short, storage, version):
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    foreign.write_rosbag2(tmp_path / "a", entries, storage, version)
    assert_holds(read_only(tmp_path, machine), short)


def test_sqlite3_without_definitions(tmp_path, machine, short):
    """As recorded before ROS 2 Iron: the standard definitions are used. The bare file is a log too."""
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    folder = foreign.write_rosbag2(tmp_path / "a", entries)
    (database,) = folder.glob("*.db3")
    connection = sqlite3.connect(database)
    connection.execute("DROP TABLE message_definitions")
    connection.commit()
    connection.close()
    assert_holds(read_only(tmp_path, machine), short)
    assert_holds(read_only(database, machine), short)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("chunked", [True, False])
def test_mcap_library(tmp_path, machine, short, compression, chunked):
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    foreign.write_mcap(tmp_path / "a.mcap", entries, compression, chunked)
    assert_holds(read_only(tmp_path, machine), short)


@pytest.mark.parametrize("with_metadata", [True, False])
def test_split_bag(tmp_path, machine, short, with_metadata):
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    (tmp_path / "run").mkdir()
    third = len(entries) // 3
    for number in range(3):
        part = entries[number * third : (number + 1) * third if number < 2 else None]
        foreign.write_mcap(tmp_path / "run" / f"run_{number}.mcap", part)
    if with_metadata:
        listing = "".join(f"\n  - run_{number}.mcap" for number in range(3))
        text = f"rosbag2_bagfile_information:\n  relative_file_paths:{listing}\n"
        (tmp_path / "run" / "metadata.yaml").write_text(text)
    assert_holds(read_only(tmp_path, machine), short)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_tables(tmp_path, machine, short, suffix):
    """Both streams in one table, at their own rates."""
    q = polars.DataFrame(
        {"t": short.stamp_ns, **{f"q_{j}": short.q[:, i] for i, j in enumerate(machine.joint_names)}}
    )
    a = polars.DataFrame(
        {"t": short.command_ns, **{f"a_{j}": short.command[:, i] for i, j in enumerate(machine.joint_names)}}
    )
    table = polars.concat([q, a], how="diagonal").sort("t")
    getattr(table, f"write_{suffix}")(tmp_path / f"a.{suffix}")
    nanoseconds = load_machine("bobcat_e10")
    nanoseconds.columns.time_unit = "ns"
    raw = read_only(tmp_path, nanoseconds)
    np.testing.assert_array_equal(raw.joint_stamp_ns, short.stamp_ns)
    np.testing.assert_array_equal(raw.q, short.q)
    np.testing.assert_array_equal(raw.command, short.command)
    assert raw.message_counts == {f"a.{suffix}": len(table)} and raw.notes == ()


def test_csv_with_stray_cells(tmp_path, machine):
    header = "t,q_swing,q_boom,q_arm,q_bucket,a_swing,a_boom,a_arm,a_bucket\n"
    rows = [f"{100 + 0.05 * i:.2f}, 0.1,0.2,-1.0,-1.0,0,1,0,-1\n" for i in range(10)]
    rows[4] = "oops,1,2,3,4,0,0,0,0\n"
    (tmp_path / "a.csv").write_text(header + "".join(rows) + "100.5,0.1,0.2")
    raw = read_only(tmp_path, machine)
    assert len(raw.q) == len(raw.command) == 9  # the last number of a row that was cut may be half a number
    np.testing.assert_array_equal(raw.joint_stamp_ns[:2], [100_000_000_000, 100_050_000_000])
    assert [note.count for note in raw.notes] == [1, 1]  # the stray row, and the cut one


def test_table_column_missing(tmp_path, machine):
    (tmp_path / "a.csv").write_text("time,q_swing\n1,2\n")
    with pytest.raises(InputError, match=r"column t, q_boom, .* is missing; .*; columns seen: time, q_swing"):
        read_only(tmp_path, machine)


def test_mixed_folder_names_every_log_once(tmp_path, machine, short):
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    foreign.write_rosbag2(tmp_path / "b" / "same", entries)
    foreign.write_mcap(tmp_path / "same.mcap", entries)
    foreign.write_rosbag1(tmp_path / "same.bag", foreign.messages(foreign.ROS1, short, machine.joint_names))
    (tmp_path / "README.md").write_text("not a log")
    (tmp_path / ".hidden.mcap").write_text("not a log")
    found = find_logs(tmp_path)
    assert [entry.name for entry in found] == ["b_same", "same_bag", "same_mcap"]
    for entry in found:
        np.testing.assert_array_equal(read_log(entry, machine).q, short.q)


def test_folders_without_logs(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        find_logs(tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: holds no logs"):
        find_logs(tmp_path / "empty")


def test_bag_folder_without_files_fails_alone(tmp_path, machine, session):
    session.write(tmp_path / "good", machine)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {relative_file_paths: [x.mcap]}"
    )
    bad, good = find_logs(tmp_path)
    assert len(read_log(good, machine).q) == len(session.q)
    with pytest.raises(InputError, match=r"without its files; metadata.yaml lists x\.mcap"):
        read_log(bad, machine)


@pytest.mark.parametrize(
    ("folder", "name"),
    [(("practice",), "bobcat_e10"), (("measured",), "rc_excavator")],
)
def test_real_logs_against_rosbags(folder, name):
    """Every bag beside the project, against `rosbags` message by message."""
    from rosbags.highlevel import AnyReader

    machine = load_machine(name)
    directory = shared_folder(*folder)
    entries = find_logs(directory)
    assert len(entries) == len(list(directory.rglob("metadata.yaml")))
    for entry in entries[:: 4 if name == "bobcat_e10" else 3]:
        raw = read_log(entry, machine)
        stamps, positions, commands = [], [], []
        with AnyReader([entry.path]) as reader:
            for connection, time_ns, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                if connection.topic == "/joint_states":
                    stamps.append((message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, time_ns))
                    positions.append([message.position[message.name.index(j)] for j in machine.joint_names])
                elif connection.topic == "/joint_commands":
                    commands.append([time_ns, *message.data])
        np.testing.assert_array_equal(
            np.array(stamps), np.stack([raw.joint_stamp_ns, raw.joint_log_time_ns], axis=1)
        )
        np.testing.assert_array_equal(raw.q, positions)
        np.testing.assert_array_equal(raw.command_log_time_ns, [int(command[0]) for command in commands])
        np.testing.assert_array_equal(raw.command, [command[1:] for command in commands])
        assert raw.notes == ()
