"""Read one log of any format into a `RawLog`."""

import math
from collections.abc import Callable, Container, Iterator
from dataclasses import replace
from functools import partial

from pipeline.errors import InputError
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat
from pipeline.logs.formats.lerobot.log import read_lerobot
from pipeline.logs.formats.mcap.file import read_mcap
from pipeline.logs.formats.rosbag1.file import read_rosbag1
from pipeline.logs.formats.sqlite3.file import read_sqlite3
from pipeline.logs.formats.tables import read_table
from pipeline.logs.messages.channel_sources import channel_collectors, finish_channels
from pipeline.logs.messages.columns import ColumnStore, MemoryStore
from pipeline.logs.messages.command_sources import command_adapter
from pipeline.logs.messages.joint_states import TargetPoseAdapter, joint_state_adapter
from pipeline.logs.messages.message_blocks import MessageBlock, ReadingLedger, StorageReader
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog, TargetPoses
from pipeline.logs.messages.topic_columns import TopicColumns
from pipeline.machine.specification import MachineSpecification

STORAGE_READERS: dict[LogFormat, StorageReader] = {
    LogFormat.mcap: read_mcap,
    LogFormat.rosbag1: read_rosbag1,
    LogFormat.sqlite3: read_sqlite3,
}
TableReader = Callable[[LogEntry, MachineSpecification, ColumnStore], RawLog]


def read_log(
    entry: LogEntry,
    machine: MachineSpecification,
    store: ColumnStore | None = None,
    maximum_gap_s: float = math.inf,
) -> RawLog:
    """Read one log.

    Args:
        entry: A log that `find_logs` found.
        machine: Names topics, joints and the command source.
        store: Stores the columns; in memory by default.
        maximum_gap_s: Longest pause of a frame over which positions that stand in several CAN frames are joined.

    Raises:
        InputError: The log cannot be read at all, lacks a topic or joint of the machine, or is of another type.
    """
    if entry.error:
        raise InputError(entry.error)
    if store is None:
        store = MemoryStore()
    if entry.format in STORAGE_READERS:
        return _read_bag(entry, machine, store)
    if entry.format is LogFormat.can:
        # Other logs need not wait for python-can and cantools.
        from pipeline.logs.formats.can.log import read_can

        read: TableReader = partial(read_can, maximum_gap_s=maximum_gap_s)
    elif entry.format is LogFormat.lerobot:
        read = read_lerobot
    else:
        read = read_table
    raw = read(entry, machine, store)
    return replace(raw, notes=(*entry.notes, *raw.notes))


def readable_blocks(entry: LogEntry, ledger: ReadingLedger, wanted: Container[str]) -> Iterator[MessageBlock]:
    """Yield the blocks of a bag's files; an unreadable file of a split bag is noted, and the others are read.

    Raises:
        InputError: The bag's only file cannot be read.
    """
    for path in entry.files:
        try:
            yield from STORAGE_READERS[entry.format](path, ledger, wanted)
        except InputError as error:
            if len(entry.files) == 1:
                raise
            reason = str(error).replace(str(path), path.name)
            ledger.notes.append(Note(NoteKind.damage, f"{ledger.path.name}: the file is lost: {reason}"))


def _read_bag(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
    joint_states = TopicColumns(machine.joint_states.topic, joint_state_adapter(machine), store)
    commands = TopicColumns(machine.commands.topic, command_adapter(machine), store)
    pose_adapter = TargetPoseAdapter()
    targets = TopicColumns(machine.target_topic, pose_adapter, store)
    channels = channel_collectors(machine, store)
    collectors = (joint_states, commands, targets, *channels.values())
    wanted = {collector.topic_name for collector in collectors}
    ledger = ReadingLedger(entry.path)
    for note in entry.notes:
        ledger.notes.append(note)
    for block in readable_blocks(entry, ledger, wanted):
        for collector in collectors:
            if collector.topic_name == block.topic.name:
                collector.add(block)
    if entry.message_count is not None:
        ledger.compare_counts("metadata.yaml states", entry.message_count, sum(ledger.counts.values()))
    sampled, commanded = joint_states.finish(ledger), commands.finish(ledger)
    poses = None
    if not targets.is_empty:
        columns = targets.finish(ledger)
        frames = sorted(pose_adapter.frame_ids)
        if len(frames) > 1:
            raise InputError(
                f"{entry.path}: target poses stand in several frames: {', '.join(frames)}; use one"
            )
        poses = TargetPoses(columns["log_time_ns"], columns["position"], columns["quaternion"], frames[0])
    found = finish_channels(channels, ledger)
    return RawLog(
        name=entry.name,
        path=entry.path,
        joint_stamp_ns=sampled["stamp_ns"],
        joint_log_time_ns=sampled["log_time_ns"],
        q=sampled["q"],
        command_log_time_ns=commanded["log_time_ns"],
        command=commanded["command"],
        command_stamp_ns=commanded.get("stamp_ns"),
        targets=poses,
        message_counts=dict(ledger.counts),
        notes=tuple(ledger.notes),
        channels=found,
    )
