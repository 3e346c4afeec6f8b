"""Where a command reads and writes: nothing that is only read is changed, and what is to be written can be."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError


@dataclass(frozen=True)
class Output:
    """How a setting's path is written to.

    Attributes:
        is_file: Whether it is a file, not a folder.
        replaced: Entries of the folder that are deleted or written over; `.` is all of it.
    """

    is_file: bool = False
    replaced: tuple[str, ...] = ()


@dataclass(frozen=True)
class Input:
    """How a setting's paths are read.

    Attributes:
        is_of_logs: Whether every log in such a folder is read, so that a new one there would be one of them.
        is_whole: Whether it is one thing, in which nothing else may lie: a model, a policy.
    """

    is_of_logs: bool = False
    is_whole: bool = False


def refuse_overlap(
    writes: Mapping[str, tuple[str, Output]], reads: Mapping[str, tuple[Sequence[str], Input]]
) -> None:
    """Raise `InputError` if writing would change what is only read, links followed.

    A result may lie beside or around what it was made from, a report also among logs; but not in its place.

    Args:
        writes: A path and how it is written to, by the names of the settings that give them.
        reads: Paths and how they are read, in the same way.
    """
    for name, (paths, reading) in reads.items():
        for path in paths:
            for written, (place, writing) in writes.items():
                relation = _harm(place, writing, path, reading)
                if relation:
                    raise InputError(
                        f"{written}={place}: {relation} {name}={path}, which is only read; name another {written}"
                    )


def _harm(written: str, writing: Output, path: str, reading: Input) -> str | None:
    """How writing would change what is read; None: it would not."""
    own, read = _place(written), _place(path)
    if own == read:
        return "is"
    if any(read.is_relative_to(_place(f"{written}/{entry}")) for entry in writing.replaced):
        return "contains"
    if not own.is_relative_to(read):
        return None
    may_be_log = reading.is_of_logs and not (writing.is_file and own.suffix == ".json")
    return "lies in" if reading.is_whole or may_be_log else None


def _place(path: str) -> Path:
    return Path(os.path.realpath(path))  # unlike Path.resolve it does not mind links that are loops


def refuse_unusable(name: str, path: str, is_file: bool) -> None:
    """Raise `InputError` if a place cannot be written to, which would else be found after the work.

    Args:
        name: Of the setting that gives it.
        path: As given.
        is_file: Whether it is to be a file, not a folder.
    """
    if not path:
        raise InputError(f"{name} is empty; name a {'file' if is_file else 'folder'} to write")
    if is_file and Path(path).is_dir():
        raise InputError(f"{name}={path}: is a folder; name the file to write")
    folder = _nearest(name, Path(path).parent if is_file else Path(path))
    if not folder.is_dir():
        raise InputError(f"{name}={path}: {folder} is no folder; move it away, or name another {name}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(
            f"{name}={path}: {folder} must not be written to; change its permissions, or name another {name}"
        )


def _nearest(name: str, folder: Path) -> Path:
    """The folder, or the nearest of those around it that is there, were it a link that leads nowhere."""
    for place in (folder, *folder.parents):
        try:
            place.lstat()
            return place
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise InputError(f"{name}: {place}: {error.strerror}; name another {name}") from error
    return Path()
