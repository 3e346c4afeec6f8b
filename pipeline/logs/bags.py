"""Reads one log of any format into a `RawLog`."""

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.command_sources import command_adapter
from pipeline.logs.discover import LogEntry, LogFormat
from pipeline.logs.joint_states import JointStateAdapter, TargetPoseAdapter
from pipeline.logs.mcap_file import read_mcap
from pipeline.logs.message_blocks import ReadingLedger, StorageReader
from pipeline.logs.raw_log import Note, NoteKind, RawLog, TargetPoses
from pipeline.logs.rosbag1_file import read_rosbag1
from pipeline.logs.sqlite3_file import read_sqlite3
from pipeline.logs.tables import read_table
from pipeline.logs.topic_columns import TopicColumns
from pipeline.machine.specification import MachineSpecification

STORAGE_READERS: dict[LogFormat, StorageReader] = {
    LogFormat.mcap: read_mcap,
    LogFormat.rosbag1: read_rosbag1,
    LogFormat.sqlite3: read_sqlite3,
}


def read_log(entry: LogEntry, machine: MachineSpecification) -> RawLog:
    """Read one log.

    Args:
        entry: A log that `find_logs` found.
        machine: Names topics, joints and the command source.

    Raises:
        InputError: The log cannot be read at all, lacks a topic or joint of the machine, or is of another
        type.
    """
    if entry.error:
        raise InputError(entry.error)
    if entry.format in STORAGE_READERS:
        return _read_bag(entry, machine, STORAGE_READERS[entry.format])
    return read_table(entry, machine)


def _read_bag(entry: LogEntry, machine: MachineSpecification, reader: StorageReader) -> RawLog:
    joint_states = TopicColumns(machine.joint_states.topic, JointStateAdapter(machine.joint_names))
    commands = TopicColumns(machine.commands.topic, command_adapter(machine))
    targets = TopicColumns(machine.target_topic, TargetPoseAdapter())
    collectors = (joint_states, commands, targets)
    wanted = {collector.topic_name for collector in collectors}
    ledger = ReadingLedger(entry.path)
    for name in entry.missing:
        ledger.notes.append(
            Note(NoteKind.damage, f"{entry.path.name}: file {name} is listed in metadata.yaml and missing")
        )
    for path in entry.files:
        for block in reader(path, ledger, wanted):
            for collector in collectors:
                if collector.topic_name == block.topic.name:
                    collector.add(block)
    sampled, commanded = joint_states.finish(ledger), commands.finish(ledger)
    poses = None
    if targets.blocks:
        columns = targets.finish(ledger)
        frames = np.unique(columns["frame_id"])
        if len(frames) > 1:
            raise InputError(
                f"{entry.path}: target poses stand in several frames: {', '.join(frames)}; use one"
            )
        poses = TargetPoses(
            columns["log_time_ns"], columns["position"], columns["quaternion"], str(frames[0])
        )
    return RawLog(
        name=entry.name,
        path=entry.path,
        joint_stamp_ns=sampled["stamp_ns"],
        joint_log_time_ns=sampled["log_time_ns"],
        q=sampled["q"],
        command_log_time_ns=commanded["log_time_ns"],
        command=commanded["command"],
        targets=poses,
        message_counts=dict(ledger.counts),
        notes=tuple(ledger.notes),
    )
