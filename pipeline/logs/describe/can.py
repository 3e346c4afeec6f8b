"""Add what a CAN log holds to the contents of a folder."""

from pathlib import Path

import numpy as np
from cantools.database import Database, Message
from cantools.database.errors import Error as CantoolsError

from pipeline.errors import InputError
from pipeline.logs.describe.contents import Contents, Stream
from pipeline.logs.formats.can.frames import read_frames, time_ns
from pipeline.logs.formats.can.signals import load_database_file
from pipeline.logs.formats.log_entry import LogEntry
from pipeline.logs.messages.message_blocks import ReadingLedger

CAN_FRAME = "CAN frame"  # type of the streams
SIGNALS_OF = 20_000  # frames of each kind whose signals are decoded


def database_beside(directory: Path) -> Database | None:
    """The only DBC file in a folder and its subfolders; None if there is none, or several.

    Raises:
        InputError: It cannot be read.
    """
    found = sorted(directory.rglob("*.dbc")) if directory.is_dir() else []
    return load_database_file(found[0]) if len(found) == 1 else None


def add_can(entry: LogEntry, contents: Contents, database: Database | None) -> None:
    """Add the frames of a CAN log, with their signals if a DBC file describes them.

    Raises:
        InputError: The log cannot be read, or holds no frames.
    """
    ledger = ReadingLedger(entry.path)
    times: dict[tuple[int, bool], list[int]] = {}
    signals: dict[tuple[int, bool], list[bytes]] = {}
    for path in entry.files:
        for frame in read_frames(path, ledger):
            key, at_ns = (frame.arbitration_id, frame.is_extended_id), time_ns(frame)
            if at_ns is not None:
                times.setdefault(key, []).append(at_ns)
                if len(payloads := signals.setdefault(key, [])) < SIGNALS_OF:
                    payloads.append(bytes(frame.data))
    if not times:
        raise InputError(f"{entry.path}: no frames")
    messages = database.messages if database is not None else []
    described = {(message.frame_id, message.is_extended_frame): message for message in messages}
    for key, own in sorted(times.items()):
        message = described.get(key)
        name = message.name if message is not None else f"0x{key[0]:X}"
        stream = contents.stream((CAN_FRAME, name), name, CAN_FRAME)
        stream.end_log(len(own), [np.array(own, np.int64)])
        if message is None:
            stream.note = (
                f"{max(map(len, signals[key]))} bytes; put one DBC file beside the logs to see signals"
            )
        else:
            _add_signals(message, signals[key], stream)
    damage = f"; {ledger.notes[0].text}" if ledger.notes else ""
    contents.logs.append(f"{entry.path}: {sum(map(len, times.values()))} frames{damage}")


def _add_signals(message: Message, payloads: list[bytes], stream: Stream) -> None:
    units = {signal.name: signal.unit or "" for signal in message.signals}
    stream.add_fields(dict.fromkeys(units, "signal"))
    for name, unit in units.items():
        stream.fields[name].unit = unit
    for payload in payloads:
        try:
            decoded = message.decode_simple(payload, decode_choices=False)
        except (CantoolsError, ValueError):
            continue
        for name, value in decoded.items():
            if isinstance(value, int | float):
                stream.fields[name].add_numbers(np.array([[value]]))
