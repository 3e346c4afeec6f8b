"""Logs with nothing in them, or not what is wanted."""

from pathlib import Path

import polars

from tests.logs.damage.case import Damaged, case, refused
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import (
    MCAP,
    ROS1,
    SQLITE,
    TABLES,
    WholeLog,
    entries_of,
    write_table,
)


@case("empty file", *ROS1[:1], "MCAP", SQLITE, *TABLES)
def empty_file(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b""))


@case("a file that is not a log", "ROS 1", "MCAP", SQLITE, *TABLES)
def no_log(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b"this is no log, whatever its name says\n" * 9))


@case("a `.bag.active` that is not a log", "ROS 1")
def no_active_log(folder: Path, log: WholeLog) -> Damaged:
    path = folder / "a.bag.active"
    path.write_bytes(bytes(5000))
    return refused(path)


@case("random bytes", "ROS 1", "MCAP", SQLITE, *TABLES)
def random_bytes(folder: Path, log: WholeLog) -> Damaged:
    """Behind the format's own first bytes, where it has any."""
    head = {"ROS 1": 13, "MCAP": 8, SQLITE: 16, "CSV": 0, "Parquet": 4}[log.kind]
    noise = bytes((i * i * 7919 + i // 3) % 251 for i in range(20_000))
    return refused(log.write(folder / "a", log.content[:head] + noise))


def _write_bag(folder: Path, log: WholeLog, entries: list[tuple[int, str, object]]) -> Path:
    if log.kind in ROS1:
        return foreign.write_rosbag1(folder / "a.bag", entries)
    if log.kind in MCAP:
        return foreign.write_mcap(folder / "a.mcap", entries)
    return foreign.write_rosbag2(folder / "a", entries)


def _entries(log: WholeLog) -> list[tuple[int, str, object]]:
    return entries_of(foreign.ROS1 if log.kind in ROS1 else foreign.ROS2)


@case("no messages", "ROS 1", "MCAP", SQLITE)
def no_messages(folder: Path, log: WholeLog) -> Damaged:
    return refused(_write_bag(folder, log, []), "topic /joint_states is not in the log.*seen: none")


@case("no rows", *TABLES)
def no_rows(folder: Path, log: WholeLog) -> Damaged:
    return refused(write_table(folder / f"a{log.suffix}", n_rows=0), "no row holds a time and positions")


@case("no command topic", "ROS 1", "MCAP", SQLITE)
def no_command_topic(folder: Path, log: WholeLog) -> Damaged:
    entries = [entry for entry in _entries(log) if entry[1] != "/joint_commands"]
    said = r"commands: topic /joint_commands is not in the log.*/joint_states \(sensor_msgs/msg/JointState"
    return refused(_write_bag(folder, log, entries), said)


@case("no joint-state topic", "ROS 1", "MCAP", SQLITE)
def no_joint_topic(folder: Path, log: WholeLog) -> Damaged:
    entries = [entry for entry in _entries(log) if entry[1] != "/joint_states"]
    said = r"joint states: topic /joint_states is not in the log.*/joint_commands \(std_msgs/msg/Int8Multi"
    return refused(_write_bag(folder, log, entries), said)


@case("command topic of another type", "ROS 1", "MCAP", SQLITE)
def wrong_type(folder: Path, log: WholeLog) -> Damaged:
    store = foreign.ROS1 if log.kind in ROS1 else foreign.ROS2
    entries = [
        (time, topic, foreign.joy(store, time, [0.0] * 4) if topic == "/joint_commands" else message)
        for time, topic, message in _entries(log)
    ]
    said = "/joint_commands can be used: they are sensor_msgs/msg/Joy, not an array; set commands.source"
    return refused(_write_bag(folder, log, entries), said)


@case("no column of commands", *TABLES)
def no_command_column(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    frame = polars.read_csv(path) if log.kind == "CSV" else polars.read_parquet(path)
    frame = frame.drop("a_arm")
    frame.write_csv(path) if log.kind == "CSV" else frame.write_parquet(path)
    return refused(path, "column a_arm is missing; map it in conf/machine/.*columns seen: t, q_swing")


@case("words where numbers should be", *TABLES)
def words(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    frame = polars.read_csv(path) if log.kind == "CSV" else polars.read_parquet(path)
    frame = frame.with_columns(polars.lit("word").alias("t"))
    frame.write_csv(path) if log.kind == "CSV" else frame.write_parquet(path)
    return refused(path, "no row holds a time and positions; check the column map")
