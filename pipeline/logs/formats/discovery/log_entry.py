"""One log: its name, its format, its files; what a file is by its name."""

import enum
import errno
import os
from dataclasses import dataclass
from pathlib import Path

from pipeline.logs.formats.can import detect as can_logs
from pipeline.logs.formats.compression.compressed_file import COMPRESSED_SUFFIXES
from pipeline.logs.formats.opened_file import why_unreadable
from pipeline.logs.messages.raw_log import Note


class LogFormat(enum.StrEnum):
    """File formats, by their reader."""

    mcap = "mcap"
    rosbag1 = "rosbag1"
    sqlite3 = "sqlite3"
    csv = "csv"
    parquet = "parquet"
    can = "can"
    lerobot = "lerobot"


UNREAD_SUFFIXES = (".gz", ".bz2", ".xz", ".lz4", ".zip", *COMPRESSED_SUFFIXES)
NOT_UTF8 = "{}: its name is not UTF-8; rename it"
FORMATS = {
    ".mcap": LogFormat.mcap,
    ".bag": LogFormat.rosbag1,
    ".active": LogFormat.rosbag1,  # left by a crashed `rosbag record`
    ".db3": LogFormat.sqlite3,
    ".csv": LogFormat.csv,
    ".parquet": LogFormat.parquet,
}


@dataclass(frozen=True)
class LogEntry:
    """One log: a file, or a bag folder whose files belong together.

    Attributes:
        name: Unique within the folder that was searched.
        path: The file or the bag folder.
        format: Format of its files.
        files: Its files in the order of recording.
        notes: What was found out before it is read, such as missing files.
        message_count: Number of messages that `metadata.yaml` states, if it does.
        part: Which episode of its files, where these hold several logs.
        rows: Of the file from its first frame to behind its last one, where it is such an episode.
        error: Why it cannot be read, if already known; `read_log` raises it.
    """

    name: str
    path: Path
    format: LogFormat
    files: tuple[Path, ...]
    notes: tuple[Note, ...] = ()
    message_count: int | None = None
    part: int | None = None
    rows: tuple[int, int] | None = None
    error: str = ""


def broken(path: Path, reason: str) -> LogEntry:
    """A log that cannot be read, and why."""
    return LogEntry(printable(path.name), path, LogFormat.mcap, (), error=reason)


def file_entry(path: Path) -> LogEntry | None:
    """A single file as a log, by its name; None if it is something else."""
    if printable(path.name) != path.name:
        return broken(path, NOT_UTF8.format(path)) if could_be_log(path) else None
    log_format = format_of(path)
    if log_format is None:
        text = f"{path}: compressed as {path.suffix}, which is not read; decompress it"
        return broken(path, text) if could_be_log(path) else None
    plain = uncompressed(path)
    name = plain.name.removesuffix(".active").removesuffix(plain.suffix).removesuffix(".bag")
    try:
        reason = why_unreadable(path)
    except OSError as error:
        reason = f"{path}: cannot be read ({error.strerror}); check where it points to"
    return LogEntry(name, path, log_format, () if reason else (path,), error=reason or "")


def format_of(path: Path) -> LogFormat | None:
    """Return a file's format, by its name; compressed tables are not supported."""
    is_can_suffix = uncompressed(path).suffix.lower() in can_logs.SUFFIXES
    if is_can_suffix and is_regular_file(path) and can_logs.is_can_log(path):
        return LogFormat.can
    found = FORMATS.get(uncompressed(path).suffix.lower())
    return None if path != uncompressed(path) and found in (LogFormat.csv, LogFormat.parquet) else found


def could_be_log(path: Path) -> bool:
    """Whether a file has a log's suffix, alone or before that of a compression, or is a compressed CAN log."""
    inner = path.with_suffix("") if path.suffix.lower() in UNREAD_SUFFIXES else path
    return inner.suffix.lower() in FORMATS or (
        inner != path and is_regular_file(path) and can_logs.is_can_log(path)
    )


def uncompressed(path: Path) -> Path:
    """Return the path without a compression suffix."""
    return path.with_suffix("") if path.suffix in COMPRESSED_SUFFIXES else path


def is_regular_file(path: Path) -> bool:
    """Whether it is a regular file; opening a pipe would block. Unreadable files count: their reader reports them."""
    try:
        return why_unreadable(path) is None
    except (FileNotFoundError, ValueError):  # no path holds a zero byte
        return False
    except OSError as error:
        return error.errno != errno.ENAMETOOLONG


def printable(name: str) -> str:
    """Return a file's name, with replacement characters where it is not UTF-8."""
    return os.fsencode(name).decode(errors="replace")
