"""Where a command reads and writes: no place is for both, and what is to be written can be."""

import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from pipeline.errors import InputError


def refuse_overlap(writes: Mapping[str, str], reads: Mapping[str, str | Iterable[str]]) -> None:
    """Raise `InputError` if a place to write is, contains or lies in a place to read, links followed.

    Args:
        writes: Paths by the names of the settings that give them.
        reads: The same; a setting may give several paths.
    """
    for name, given in reads.items():
        for path in [given] if isinstance(given, str) else given:
            for written, output in writes.items():
                relation = _relation(output, path)
                if relation:
                    raise InputError(
                        f"{written}={output}: {relation} {name}={path}, which is only read; name another {written}"
                    )


def refuse_unusable(writes: Mapping[str, str], files: Collection[str]) -> None:
    """Raise `InputError` if a place cannot be written to, which would else be found after the work.

    Args:
        writes: Paths by the names of the settings that give them.
        files: Names of those that are to be files; the others are to be folders.
    """
    for name, path in writes.items():
        if not path:
            raise InputError(f"{name} is empty; name a {'file' if name in files else 'folder'} to write")
        if name in files and Path(path).is_dir():
            raise InputError(f"{name}={path}: is a folder; name the file to write")
        folder = _nearest(name, Path(path).parent if name in files else Path(path))
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


def _relation(output: str, read: str) -> str | None:
    """How a place to write stands to one to read; None: apart."""
    # unlike Path.resolve it does not mind links that are loops
    own, other = (Path(os.path.realpath(path)) for path in (output, read))
    if own == other:
        return "is"
    if other.is_relative_to(own):
        return "contains"
    return "lies in" if own.is_relative_to(other) else None
