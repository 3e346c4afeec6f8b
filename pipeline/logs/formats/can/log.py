"""Read a CAN log into a `RawLog`."""

from collections import Counter

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.can.frames import read_frames, time_ns
from pipeline.logs.formats.can.merged import MergedFrames
from pipeline.logs.formats.can.signals import JointSignals, joint_signals, load_database, single_signal
from pipeline.logs.formats.discover import LogEntry
from pipeline.logs.messages.channel_sources import channel_table, stored_channels
from pipeline.logs.messages.columns import SECTION_ROWS, Column, ColumnStore
from pipeline.logs.messages.conversion import Conversion, command_conversion, position_conversion
from pipeline.logs.messages.message_blocks import ReadingLedger
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog, first_damage, timed_by_one_clock
from pipeline.machine.specification import MachineSpecification

LISTED_FRAMES = 24


class _Collector:
    """Gathers the signals of one role (positions or commands) and stores rows of them."""

    def __init__(
        self,
        role: str,
        signals: JointSignals,
        conversion: Conversion,
        n_joint: int,
        is_held: bool,
        store: ColumnStore,
        is_channel: bool = False,
    ) -> None:
        self.is_channel = is_channel
        self.role, self.signals, self.conversion, self.store = role, signals, conversion, store
        self.numbers = {
            (frame.frame_id, frame.is_extended_frame): number for number, frame in enumerate(signals.frames)
        }
        self.merged = MergedFrames(signals.joints, n_joint, is_held)
        self.waiting: list[tuple[list[int], list[np.ndarray]]] = [([], []) for _ in signals.frames]
        self.n_waiting = self.n_unusable = 0

    def add(self, key: tuple[int, bool], at_ns: int, data: bytes) -> None:
        """Decode a frame if it is one of these."""
        if (number := self.numbers.get(key)) is None:
            return
        if (values := self.signals.values(number, data)) is None:
            self.n_unusable += 1
            return
        times, rows = self.waiting[number]
        times.append(at_ns)
        rows.append(values)
        self.n_waiting += 1
        if self.n_waiting >= SECTION_ROWS:
            self.flush()

    def flush(self, is_last: bool = False) -> None:
        """Store the rows that are settled."""
        for number, (times, rows) in enumerate(self.waiting):
            if times:
                self.merged.add(number, np.array(times, np.int64), np.array(rows))
        self.waiting = [([], []) for _ in self.signals.frames]
        self.n_waiting = 0
        at, values = self.merged.rows(is_last)
        is_known = ~np.isnan(values).all(axis=1)
        if is_known.any():
            found = self.conversion(values[is_known])
            self.store.append(
                self.role, {"time_ns": at[is_known], "value": found[:, 0] if self.is_channel else found}
            )

    def finish(self, entry: LogEntry, ledger: ReadingLedger) -> dict[str, Column]:
        """Return the columns, and note what was lost.

        Raises:
            InputError: The log holds none of the frames.
        """
        self.flush(is_last=True)
        names = ", ".join(frame.name for frame in self.signals.frames)
        if self.n_unusable:
            text = f"{self.n_unusable} frames {names} do not fit the DBC file; they are left out"
            ledger.notes.append(Note(NoteKind.left_out, text, self.n_unusable))
        if self.merged.n_late:
            text = f"{self.merged.n_late} frames {names} left out: they come after later ones"
            ledger.notes.append(Note(NoteKind.left_out, text, self.merged.n_late))
        columns = self.store.columns(self.role)
        if not columns:
            seen = ", ".join(
                f"{name} ({count})" for name, count in list(ledger.counts.items())[:LISTED_FRAMES]
            )
            raise InputError(
                f"{entry.path}: {self.role}: no usable frame {names}; set section can in conf/machine; "
                f"frames seen: {seen or 'none'}{first_damage(ledger.notes)}"
            )
        return columns


def read_can(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
    """Read the signals that the machine's section `can` names. Frames are timed by the log.

    Raises:
        InputError: The file cannot be read, holds no such frames, or the DBC file lacks a signal.
    """
    database = load_database(machine)
    roles = (
        ("joint states", "positions", position_conversion(machine), False),
        ("commands", "commands", command_conversion(machine), True),
    )
    positions, commands = (
        _Collector(role, joint_signals(database, machine, key), conversion, machine.n_joint, is_held, store)
        for role, key, conversion, is_held in roles
    )
    channels = {
        channel.name: _Collector(
            channel_table(channel.name), signal, Conversion(), 1, False, store, is_channel=True
        )
        for channel in machine.channels
        if channel.topic and (signal := single_signal(database, channel.topic, channel.field)) is not None
    }
    ledger = ReadingLedger(entry.path)
    counts: Counter[tuple[int, bool]] = Counter()
    n_untimed = 0
    for path in entry.files:
        for frame in read_frames(path, ledger):
            if machine.can.bus and str(frame.channel) != machine.can.bus:
                continue
            key, at_ns = (frame.arbitration_id, frame.is_extended_id), time_ns(frame)
            counts[key] += 1
            if at_ns is None:
                n_untimed += 1
                continue
            for collector in (positions, commands, *channels.values()):
                collector.add(key, at_ns, bytes(frame.data))
    if n_untimed:
        ledger.notes.append(Note(NoteKind.left_out, f"{n_untimed} frames have impossible times", n_untimed))
    names = {(frame.frame_id, frame.is_extended_frame): frame.name for frame in database.messages}
    ledger.counts |= {names.get(key, f"0x{key[0]:X}"): count for key, count in sorted(counts.items())}
    for collector in channels.values():
        collector.flush(is_last=True)
    sampled, commanded = positions.finish(entry, ledger), commands.finish(entry, ledger)
    found, seen = stored_channels(store, channels), dict(ledger.counts)
    return timed_by_one_clock(entry.name, entry.path, sampled, commanded, seen, ledger.notes, found)
