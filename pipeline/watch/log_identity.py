"""What identifies a recording: its content, whatever its file is called; and whether a file may have changed."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.tuples import Trajectory


def content_of(trajectories: Sequence[Trajectory]) -> str:
    """Of the rows on the machine's grid, with their absolute stamps."""
    digest = hashlib.sha256()
    for trajectory in trajectories:
        for column in (trajectory.stamp_ns, trajectory.q, trajectory.a):
            digest.update(f"{column.shape}".encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def files_of(entry: LogEntry) -> list[str]:
    """Path, size and time of the last change of each of a log's files: while all are the same, it is not read again."""
    part = "" if entry.part is None else f" part {entry.part}"
    return [_stated(path) + part for path in entry.files or (entry.path,)]


def _stated(path: Path) -> str:
    try:
        status = path.stat()
    except OSError:
        return f"{path} is gone"
    return f"{path.absolute()} {status.st_size} {status.st_mtime_ns}"
