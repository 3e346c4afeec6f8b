"""Add what a CAN log holds to the contents of a folder."""

from pathlib import Path

import numpy as np
from cantools.database import Database, Message
from cantools.database.errors import Error as CantoolsError

from pipeline.errors import InputError, counted
from pipeline.logs.describe.contents import MAXIMUM_STREAMS, Contents, Stream
from pipeline.logs.formats.can.frames import read_frames, time_ns
from pipeline.logs.formats.can.signals import FrameKey, key_of, load_database_file
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.messages.message_blocks import ReadingLedger

CAN_FRAME = "CAN frame"  # type of the streams
SIGNALS_OF = 20_000  # frames of each kind in a log whose signals are decoded


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
    ledger, n_frames = ReadingLedger(entry.path), 0
    messages = {key_of(message): message for message in (database.messages if database is not None else ())}
    streams: dict[FrameKey, Stream] = {}
    for path in entry.files:
        for frame in read_frames(path, ledger):
            key, at_ns = (frame.arbitration_id, frame.is_extended_id), time_ns(frame)
            if at_ns is None:
                continue
            n_frames += 1
            message = messages.get(key)
            if (stream := streams.get(key)) is None:
                stream = _stream(key, message, len(frame.data), contents)
                if len(streams) < MAXIMUM_STREAMS:
                    streams[key] = stream
            stream.add_times(np.array([at_ns]))
            if message is not None and stream.n_of_log <= SIGNALS_OF:
                _add_signals(message, bytes(frame.data), stream)
    if not n_frames:
        raise InputError(f"{entry.path}: no frames")
    for stream in contents.streams.values():
        if stream.n_of_log:
            stream.end_log()
    contents.add_log(f"{entry.path}: {counted(n_frames, 'frame')}", [*entry.notes, *ledger.notes])


def _stream(key: FrameKey, message: Message | None, length: int, contents: Contents) -> Stream:
    name = message.name if message is not None else f"0x{key[0]:X}"
    stream = contents.stream((CAN_FRAME, name), name, CAN_FRAME)
    if message is None:
        stream.note = f"{counted(length, 'byte')}; put one DBC file beside the logs to see signals"
        return stream
    stream.add_fields(dict.fromkeys((signal.name for signal in message.signals), "signal"))
    for signal in message.signals:
        stream.fields[signal.name].unit = signal.unit or ""
    return stream


def _add_signals(message: Message, data: bytes, stream: Stream) -> None:
    try:
        decoded = message.decode_simple(data, decode_choices=False)
    except (CantoolsError, ValueError):
        return
    for name, value in decoded.items():
        if isinstance(value, int | float) and name in stream.fields:
            stream.fields[name].add_numbers(np.array([[value]]))
