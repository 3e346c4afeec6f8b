"""Read a CAN log into a `RawLog`."""

from collections import Counter
from collections.abc import Callable

import numpy as np
from cantools.database import Database

from pipeline.errors import InputError
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.formats.can.frames import read_frames, time_ns
from pipeline.logs.formats.can.merged import merged_rows
from pipeline.logs.formats.can.signals import (
    FrameKey,
    JointSignals,
    joint_signals,
    key_of,
    load_database,
    single_signal,
)
from pipeline.logs.formats.log_entry import LogEntry
from pipeline.logs.messages.channel_sources import channel_table, stored_channels
from pipeline.logs.messages.columns import SECTION_ROWS, Column, ColumnStore, sections
from pipeline.logs.messages.conversion import command_conversion, position_conversion
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS, ReadingLedger
from pipeline.logs.messages.raw_log import (
    NANOSECONDS,
    Note,
    NoteKind,
    RawLog,
    first_damage,
    timed_by_one_clock,
)
from pipeline.machine.specification import MachineSpecification

Conversion = Callable[[np.ndarray], np.ndarray]
LISTED_FRAMES = 24


class _Collector:
    """Gathers the signals of one role (positions, commands or a channel) and stores rows of them."""

    def __init__(
        self, role: str, table: str, signals: JointSignals, conversion: Conversion, store: ColumnStore
    ) -> None:
        self.role, self.table, self.store = role, table, store
        self.signals, self.conversion = signals, conversion
        self.has_one_frame = len(signals.frames) == 1
        self.waiting: list[tuple[int, int, np.ndarray]] = []
        self.n_unusable = 0

    def add(self, key: FrameKey, at_ns: int, data: bytes) -> None:
        """Decode a frame that is one of these."""
        found = self.signals.values(key, data)
        self.n_unusable += found is None
        self.waiting += [(at_ns, number, values) for number, values in found or ()]
        if len(self.waiting) >= SECTION_ROWS:
            self.flush()

    def flush(self) -> None:
        """Store what was gathered."""
        if not self.waiting:
            return
        times, numbers, values = zip(*self.waiting, strict=True)
        self.waiting = []
        time_ns, value = np.array(times, np.int64), np.array(values)
        if self.has_one_frame:
            self._store_rows(time_ns, value)
        else:
            by_frame = np.column_stack([numbers, value])
            self.store.append(f"{self.table}_by_frame", {"time_ns": time_ns, "value": by_frame})

    def finish(self, is_held: bool, gap_ns: int, ledger: ReadingLedger) -> dict[str, Column]:
        """Return the columns, empty without a usable frame, and note what was lost."""
        self.flush()
        if self.n_unusable:
            text = f"{self.n_unusable} frames {self.signals.names} ({self.role}) do not fit the DBC file; left out"
            ledger.notes.append(Note(NoteKind.left_out, text, self.n_unusable))
        if found := self.store.columns(f"{self.table}_by_frame"):
            stream = (Samples(at, value) for at, value in sections((found["time_ns"], found["value"])))
            for rows in merged_rows(stream, self.signals.joints, is_held, gap_ns, self.role, ledger.notes):
                self._store_rows(rows.time_ns, rows.value)
        return self.store.columns(self.table)

    def _store_rows(self, time_ns: np.ndarray, value: np.ndarray) -> None:
        is_known = ~np.isnan(value).all(axis=1)
        self.store.append(
            self.table, {"time_ns": time_ns[is_known], "value": self.conversion(value[is_known])}
        )


def read_can(
    entry: LogEntry, machine: MachineSpecification, store: ColumnStore, maximum_gap_s: float = np.inf
) -> RawLog:
    """Read the signals that the machine's section `can` names. Frames are timed by the log.

    Args:
        entry: The log.
        machine: Names the signals.
        store: Stores the columns.
        maximum_gap_s: Longest pause of a frame over which positions in several frames are joined.

    Raises:
        InputError: The file cannot be read, holds no such frames, or the DBC file lacks a signal.
    """
    database, ledger = load_database(machine), ReadingLedger(entry.path)
    gap_ns = round(min(maximum_gap_s * NANOSECONDS, MAXIMUM_TIME_NS))
    positions, commands = (
        _Collector(role, role.replace(" ", "_"), joint_signals(database, machine, key), conversion, store)
        for role, key, conversion in (
            ("joint states", "positions", position_conversion(machine)),
            ("commands", "commands", command_conversion(machine)),
        )
    )
    channels = _channels(database, machine, store, ledger)
    collectors: dict[FrameKey, list[_Collector]] = {}
    for collector in (positions, commands, *channels.values()):
        for key in collector.signals.numbers:
            collectors.setdefault(key, []).append(collector)
    counts: Counter[FrameKey] = Counter()
    buses: dict[FrameKey, set[str]] = {key: set() for key in collectors}
    others: set[str] = set()
    n_untimed = 0
    for path in entry.files:
        for frame in read_frames(path, ledger):
            if machine.can.bus and str(frame.channel) != machine.can.bus:
                others.add(str(frame.channel))
                continue
            key, at_ns = (frame.arbitration_id, frame.is_extended_id), time_ns(frame)
            counts[key] += 1
            if at_ns is None:  # of any frame, as damage may have changed the identifier too
                n_untimed += 1
                continue
            if key in buses:
                buses[key].add(str(frame.channel))
            for collector in collectors.get(key, ()):
                collector.add(key, at_ns, bytes(frame.data))
    if n_untimed:
        ledger.notes.append(Note(NoteKind.left_out, f"{n_untimed} frames have impossible times", n_untimed))
    names = {key_of(frame): frame.name for frame in database.messages}
    ledger.counts |= {names.get(key, f"0x{key[0]:X}"): count for key, count in sorted(counts.items())}
    for key, seen in buses.items():
        if len(seen) > 1:
            text = (
                f"frame {names[key]} stands on the buses {', '.join(sorted(seen))}, and all are used; set can.bus in "
                f"conf/machine/{machine.name}.yaml to the one to be read"
            )
            ledger.notes.append(Note(NoteKind.warning, text, counts[key]))
    sampled, commanded = positions.finish(False, gap_ns, ledger), commands.finish(True, gap_ns, ledger)
    for collector, columns in ((positions, sampled), (commands, commanded)):
        if not columns or not len(columns["time_ns"]):
            listed = [f"{name} ({count})" for name, count in ledger.counts.items()]
            elsewhere = [f"frames on bus {bus}, which can.bus leaves out" for bus in sorted(others)]
            frames = ", ".join([*listed, *elsewhere][:LISTED_FRAMES]) or "none"
            raise InputError(
                f"{entry.path}: {collector.role}: no usable frame {collector.signals.names}; set section can in "
                f"conf/machine; frames seen: {frames}{first_damage(ledger.notes)}"
            )
    for collector in channels.values():
        collector.finish(True, gap_ns, ledger)
    found = stored_channels(store, channels)
    counted = dict(ledger.counts)
    return timed_by_one_clock(entry.name, entry.path, sampled, commanded, counted, ledger.notes, found)


def _channels(
    database: Database, machine: MachineSpecification, store: ColumnStore, ledger: ReadingLedger
) -> dict[str, _Collector]:
    """The channels that are signals; a name that is neither a frame's nor a topic's is noted."""
    found = {}
    for channel in machine.channels:
        role = f"channel {channel.name}"
        if not channel.topic or channel.topic.startswith("/"):  # of bags
            continue
        try:
            signals = single_signal(database, channel.topic, channel.field, role)
        except InputError as error:
            ledger.notes.append(Note(NoteKind.left_out, str(error)))
            continue
        found[channel.name] = _Collector(
            role, channel_table(channel.name), signals, lambda value: value[:, 0], store
        )
    return found
