"""Logs that are found twice: through links, as parts of a bag, or as copies beside their originals."""

import os
from dataclasses import replace
from pathlib import Path

from pipeline.logs.formats.discovery.log_entry import LogEntry, uncompressed
from pipeline.logs.messages.raw_log import Note, NoteKind

KEPT_COPY = ".orig.bag"  # the original that `rosbag reindex`, `fix` and `compress` keep beside their result


def each_once(entries: list[LogEntry], directory: Path) -> list[LogEntry]:
    """Drop logs whose files are those of another log, or copies of them, and note each at the log that stays."""
    owner_of: dict[object, LogEntry] = {}
    left_out: dict[Path, list[Note]] = {}
    # Single files follow the bags that hold them, and links and copies follow their originals.
    for entry in sorted(entries, key=lambda one: (_is_copy(one.path), -len(one.files), one.path)):
        keys = [(_identity(path), entry.part) for path in entry.files]
        owner = owner_of.get(keys[0]) if keys else None
        if owner is not None and all(key in owner_of for key in keys):
            name = entry.path.relative_to(directory)
            text = f"{name} is a copy of a file of this log, or a link to one, and is not read"
            left_out.setdefault(owner.path, []).append(Note(NoteKind.attention, text))
            left_out[entry.path] = []
        for key in keys:
            owner_of.setdefault(key, entry)
    return [
        replace(entry, notes=(*entry.notes, *left_out.get(entry.path, ())))
        for entry in entries
        if left_out.get(entry.path) != []
    ]


def _is_copy(path: Path) -> bool:
    return path.is_symlink() or original(path) != path


def original(path: Path) -> Path:
    """Return the file of which a path is a copy by its name; the path itself if there is no such file.

    After an interrupted compression only the plain file is complete.
    """
    original = (
        path.with_name(path.name.removesuffix(KEPT_COPY) + ".bag") if path.name.endswith(KEPT_COPY) else path
    )
    return next((one for one in (uncompressed(original), original) if os.path.exists(one)), path)


def _identity(path: Path) -> object:
    """Return what all links to a file and its copies have in common."""
    try:
        status = original(path).stat()
    except OSError:
        return path
    return status.st_dev, status.st_ino
