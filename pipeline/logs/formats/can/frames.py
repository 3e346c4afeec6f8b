"""Read the frames of CAN logs with `python-can`, intact or damaged."""

import logging
import math
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import can
from can.io.generic import TextIOMessageReader

from pipeline.errors import InputError, first_line
from pipeline.logs.formats.can.blf_objects import readable_pieces
from pipeline.logs.formats.can.signals import warnings_handled
from pipeline.logs.formats.can.text_lines import TextLines
from pipeline.logs.formats.opened_file import OpenedFile, opened_file
from pipeline.logs.formats.sqlite3.connection import plain_tables, read_only
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS, ReadingLedger

FAULTS = (ValueError, IndexError, KeyError, TypeError, OverflowError, NotImplementedError, AttributeError)
# What a reader takes for the header when it goes on after damage, so that it does not take a frame for it.
TEXT_READERS: dict[str, tuple[type[TextIOMessageReader], dict, str]] = {
    ".log": (can.CanutilsLogReader, {}, ""),
    ".asc": (can.ASCReader, {"relative_timestamp": False}, "no internal events logged"),
    ".trc": (can.TRCReader, {}, ""),
    ".csv": (can.io.CSVReader, {}, "header"),
}
# An ASC line with the data or the head of a frame that `python-can` would pass over, as it does with other events.
ASC_DATA = re.compile(
    r"\s[dr]\s+[\da-f]+(\s+[\da-f]{2})+(\s|$)|^\s*\d+\.\d+\s+\d+\s+[\da-f]+x?\s", re.ASCII | re.IGNORECASE
)
ASC_FRAME = re.compile(r"\s*\d+\.\d+\s+(\d+\s+(\w+\s+(Tx|Rx)|ErrorFrame)|CANFD)", re.ASCII | re.IGNORECASE)
MAXIMUM_ROW_BYTES = 1 << 16  # a CAN FD frame has 64
SQLITE_QUERY = "SELECT ts, arbitration_id, extended, remote, error, dlc, data FROM messages"
MICROSECOND_NS = 1_000
MICROSECONDS = 1_000_000  # per second


def read_frames(path: Path, ledger: ReadingLedger) -> Iterator[can.Message]:
    """Yield the frames of a file; damage is noted in the ledger. Error and remote frames are left out.

    Raises:
        InputError: The file cannot be opened, or is not of this format.
    """
    with opened_file(path, ledger) as opened:
        suffix = opened.path.suffix.lower()
        if suffix == ".blf":
            frames = _of_blf(opened)
        elif suffix == ".db":
            frames = _of_sqlite(opened)
        elif suffix in TEXT_READERS:
            frames = _of_text(opened, suffix)
        else:
            raise InputError(f"{path}: {suffix} is not read; convert it to BLF, ASC or candump's .log")
        for frame in frames:
            if not frame.is_error_frame and not frame.is_remote_frame:
                yield frame


def time_ns(frame: can.Message) -> int | None:
    """Return a frame's time, which readers give in s as a float, to the microsecond; None if it is impossible."""
    if not math.isfinite(frame.timestamp) or not 0 <= frame.timestamp < MAXIMUM_TIME_NS * 1e-9:
        return None
    return round(frame.timestamp * MICROSECONDS) * MICROSECOND_NS


def _of_text(opened: OpenedFile, suffix: str) -> Iterator[can.Message]:
    reader_type, options, header = TEXT_READERS[suffix]
    lines = TextLines(opened.file, opened.ledger, _is_lost_asc if suffix == ".asc" else _is_cut)
    reader = reader_type(lines, **options)  # type: ignore[arg-type]
    is_within, n_read = False, -1
    with closing(lines), warnings_handled("can", _DamageHandler(lines.damaged)):
        while True:
            if is_within and header:
                lines.repeat(header)
            try:
                for frame in reader:
                    is_within = True
                    if getattr(reader, "timestamps_format", None) == "relative":
                        raise InputError(
                            f"{opened.path}: its times are relative to the line before; save it with absolute times"
                        )
                    yield frame
                return
            except FAULTS as error:
                if lines.number == n_read:  # the file has ended, and what its head lacks fails again
                    return
                n_read = lines.number
                lines.damaged(f"is not read ({first_line(error)[:80]})")


def _is_cut(line: str) -> bool:
    """Whether the file ends within this line, so that its last byte may lack a digit."""
    return not line.endswith("\n")


def _is_lost_asc(line: str) -> bool:
    """Whether a line of an ASC file was a frame, and cannot be read as one."""
    is_cut = _is_cut(line) and not line.startswith("End")
    return is_cut or (ASC_FRAME.match(line) is None and ASC_DATA.search(line) is not None)


class _DamageHandler(logging.Handler):
    """Tells of the lines and objects of which `python-can` only logs that it cannot read them."""

    def __init__(self, damaged: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self.damaged = damaged

    def emit(self, record: logging.LogRecord) -> None:
        """Tell of the last one."""
        self.damaged("is not read")


def _of_blf(opened: OpenedFile) -> Iterator[can.Message]:
    def lost(reason: str) -> None:
        opened.ledger.damage(None, f"an object of a container {reason}; it is lost")

    with warnings_handled("can", _DamageHandler(lost)):
        for piece in readable_pieces(opened):
            try:
                yield from can.BLFReader(piece)
            except (*FAULTS, can.io.blf.BLFParseError, ArithmeticError) as error:
                opened.ledger.damage(None, f"a container is not read to its end ({error})")


def _of_sqlite(opened: OpenedFile) -> Iterator[can.Message]:
    """The database of `python-can`, whose own reader would open it for writing."""
    address = f"{opened.path.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with read_only(address, opened.size, MAXIMUM_ROW_BYTES) as connection:
            if "messages" not in plain_tables(connection):
                raise InputError(f"{opened.path}: has no table messages of CAN frames; restore or remove it")
            for ts, identifier, extended, remote, error, dlc, data in connection.execute(SQLITE_QUERY):
                if (
                    not isinstance(data, bytes)
                    or not isinstance(ts, int | float)
                    or not isinstance(identifier, int)
                ):
                    opened.ledger.damage(None, "a row holds no frame; it is lost")
                    continue
                yield can.Message(
                    timestamp=ts,
                    arbitration_id=identifier,
                    is_extended_id=bool(extended),
                    is_remote_frame=bool(remote),
                    is_error_frame=bool(error),
                    dlc=dlc,
                    data=data,
                )
    except sqlite3.Error as error:
        opened.ledger.damage(None, f"SQLite cannot read on ({error})")
