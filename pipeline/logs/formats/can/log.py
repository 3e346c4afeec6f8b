"""Read a CAN log into a `RawLog`."""

from collections import Counter

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
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.messages.columns import SECTION_ROWS, ColumnStore, sections
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS, ReadingLedger
from pipeline.logs.messages.one_clock import COMMANDS, POSITIONS, OneClockLog, channel_stream
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog, first_damage
from pipeline.machine.specification import MachineSpecification

LISTED_FRAMES = 24


class _Collector:
    """Gathers the signals of one role (positions, commands or a channel) and stores rows of them."""

    def __init__(self, role: str, stream: str, signals: JointSignals, log: OneClockLog) -> None:
        self.role, self.stream, self.signals, self.log = role, stream, signals, log
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
            self.log.add(self.stream, time_ns, value)
        else:
            by_frame = np.column_stack([numbers, value])
            self.log.store.append(f"{self.stream}_by_frame", {"time_ns": time_ns, "value": by_frame})

    def finish(self, gap_ns: int, ledger: ReadingLedger) -> None:
        """Store the rest, and note what was lost."""
        self.flush()
        if self.n_unusable:
            text = f"{self.n_unusable} frames {self.signals.names} ({self.role}) do not fit the DBC file; left out"
            ledger.notes.append(Note(NoteKind.left_out, text, self.n_unusable))
        if found := self.log.store.columns(f"{self.stream}_by_frame"):
            stream = (Samples(at, value) for at, value in sections((found["time_ns"], found["value"])))
            is_held = self.stream != POSITIONS
            for rows in merged_rows(stream, self.signals.joints, is_held, gap_ns, self.role, ledger.notes):
                self.log.add(self.stream, rows.time_ns, rows.value)


def read_can(
    entry: LogEntry, machine: MachineSpecification, store: ColumnStore, maximum_gap_s: float = np.inf
) -> RawLog:
    """Read the signals that the machine's section `can` names. Frames are timed by the log.

    Args:
        machine: Names the signals.
        store: Stores the columns.
        maximum_gap_s: Longest pause of a frame over which positions in several frames are joined.

    Raises:
        InputError: The file cannot be read, holds no such frames, or the DBC file lacks a signal.
    """
    database, ledger = load_database(machine), ReadingLedger(entry.path)
    gap_ns = round(min(maximum_gap_s * NANOSECONDS, MAXIMUM_TIME_NS))
    log = OneClockLog(machine, store)
    collectors = {
        stream: _Collector(role, stream, joint_signals(database, machine, stream), log)
        for role, stream in (("joint states", POSITIONS), ("commands", COMMANDS))
    }
    collectors |= _channels(database, machine, log, ledger)
    by_key: dict[FrameKey, list[_Collector]] = {}
    for collector in collectors.values():
        for key in collector.signals.numbers:
            by_key.setdefault(key, []).append(collector)
    counts: Counter[FrameKey] = Counter()
    buses: dict[FrameKey, set[str]] = {key: set() for key in by_key}
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
            for collector in by_key.get(key, ()):
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
    for collector in collectors.values():
        collector.finish(gap_ns, ledger)

    def refusal(stream: str) -> str:
        listed = [f"{name} ({count})" for name, count in ledger.counts.items()]
        elsewhere = [f"frames on bus {bus}, which can.bus leaves out" for bus in sorted(others)]
        frames = ", ".join([*listed, *elsewhere][:LISTED_FRAMES]) or "none"
        return (
            f"{entry.path}: {collectors[stream].role}: no usable frame {collectors[stream].signals.names}; set section "
            f"can in conf/machine; frames seen: {frames}{first_damage(ledger.notes)}"
        )

    return log.finish(entry.name, entry.path, dict(ledger.counts), ledger.notes, refusal)


def _channels(
    database: Database, machine: MachineSpecification, log: OneClockLog, ledger: ReadingLedger
) -> dict[str, _Collector]:
    """The channels that are signals, by stream; a name that is neither a frame's nor a topic's is noted."""
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
        stream = channel_stream(channel.name)
        found[stream] = _Collector(role, stream, signals, log)
    return found
