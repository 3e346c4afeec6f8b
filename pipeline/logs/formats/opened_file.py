"""Open one file of a bag, plain or compressed, and turn reading errors into one line."""

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BufferedReader
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.formats.compression.compressed_file import COMPRESSED_SUFFIXES, decompress_file
from pipeline.logs.messages.message_blocks import ReadingLedger

KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


@dataclass(frozen=True)
class OpenedFile:
    """A file that is open for reading.

    Attributes:
        file: The file, at its beginning.
        path: Its own path, or that of a decompressed copy.
        size: Its length in bytes.
        ledger: The bag's ledger; notes on damage name this file.
    """

    file: BufferedReader
    path: Path
    size: int
    ledger: ReadingLedger


@contextmanager
def opened_file(path: Path, ledger: ReadingLedger) -> Iterator[OpenedFile]:
    """Open a file; a compressed one (`.zstd`, `.zst`) is decompressed into a temporary folder first.

    Raises:
        InputError: It is not a regular file, cannot be opened, fails while it is read, or its decompressed copy does
            not fit on the disk.
    """
    own = replace(ledger, path=path)  # shares the bag's counts and notes
    try:
        if (reason := why_unreadable(path)) is not None:
            raise InputError(reason)
        with path.open("rb") as file:
            if path.suffix not in COMPRESSED_SUFFIXES:
                yield OpenedFile(file, path, os.fstat(file.fileno()).st_size, own)
                return
            with tempfile.TemporaryDirectory() as folder:
                copy = Path(folder) / path.stem
                decompress_file(path, file, copy, own)
                named = replace(ledger, path=path.with_name(f"{path.name} (decompressed)"))
                with copy.open("rb") as plain:
                    yield OpenedFile(plain, copy, copy.stat().st_size, named)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {_remedy(error)}") from error


def why_unreadable(path: Path) -> str | None:
    """Return in one line why a path is not a readable file; None if it is.

    Check before opening: opening a named pipe would block.
    """
    kind = stat.S_IFMT(path.stat().st_mode)
    if kind == stat.S_IFREG:
        return None
    return f"{path}: {KINDS.get(kind, 'something else')}, not a file; name the log itself"


def _remedy(error: OSError) -> str:
    if error.errno == errno.ENOSPC:
        return f"free some room in {tempfile.gettempdir()}, or let TMPDIR name a folder that has more"
    if error.errno == errno.ENOENT:
        return "check that it is still there"
    if isinstance(error, PermissionError):
        return "check its permissions"
    return "check the disk that it lies on"
