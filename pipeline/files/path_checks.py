"""Checks of paths before work starts: inputs are not overwritten, and outputs can be written."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError


@dataclass(frozen=True)
class Output:
    """How an output path is written.

    Attributes:
        is_file: Whether the path is a file, not a folder.
        replaced: Entries of the folder that are deleted or overwritten; `.` means all of them.
    """

    is_file: bool = False
    replaced: tuple[str, ...] = ()


@dataclass(frozen=True)
class Input:
    """How input paths are read.

    Attributes:
        is_of_logs: Whether every log in the folder is read, so that a new log there would become an input.
        is_whole: Whether the folder is one artifact (a model, a policy) that may hold nothing else.
    """

    is_of_logs: bool = False
    is_whole: bool = False


def refuse_overlap(
    writes: Mapping[str, tuple[str, Output]], reads: Mapping[str, tuple[Sequence[str], Input]]
) -> None:
    """Raise `InputError` if an output would change an input; links are followed.

    A result may lie beside or around its input, and a report also among logs, but it may not replace the input.

    Args:
        writes: Output path and kind by the name of its setting.
        reads: Input paths and kind by the name of their setting.
    """
    for name, (paths, reading) in reads.items():
        for path in paths:
            for written, (place, writing) in writes.items():
                relation = _conflict(place, writing, path, reading)
                if relation:
                    raise InputError(
                        f"{written}={place}: {relation} {name}={path}, which is only read; name another {written}"
                    )


def _conflict(written: str, writing: Output, path: str, reading: Input) -> str | None:
    """How the output would change the input; None if it would not."""
    own, read = _real_path(written), _real_path(path)
    if own == read:
        return "is"
    if any(read.is_relative_to(_real_path(f"{written}/{entry}")) for entry in writing.replaced):
        return "contains"
    if not own.is_relative_to(read):
        return None
    may_be_log = reading.is_of_logs and not (writing.is_file and own.suffix == ".json")
    return "lies in" if reading.is_whole or may_be_log else None


def _real_path(path: str) -> Path:
    return Path(os.path.realpath(path))  # unlike Path.resolve, realpath accepts link loops


def refuse_unusable(name: str, path: str, is_file: bool) -> None:
    """Raise `InputError` if an output cannot be written, before the work rather than after it.

    Args:
        name: Name of the setting.
        path: As given.
        is_file: Whether the path is a file, not a folder.
    """
    if not path:
        raise InputError(f"{name} is empty; name a {'file' if is_file else 'folder'} to write")
    if is_file and Path(path).is_dir():
        raise InputError(f"{name}={path}: is a folder; name the file to write")
    folder = _nearest(name, Path(path).parent if is_file else Path(path))
    if not folder.is_dir():
        raise InputError(f"{name}={path}: {folder} is not a folder; move it away, or name another {name}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(
            f"{name}={path}: {folder} must not be written to; change its permissions, or name another {name}"
        )


def _nearest(name: str, folder: Path) -> Path:
    """The nearest existing path at or above `folder`; a broken link counts as existing."""
    for place in (folder, *folder.parents):
        try:
            place.lstat()
            return place
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise InputError(f"{name}: {place}: {error.strerror}; name another {name}") from error
    return Path()
