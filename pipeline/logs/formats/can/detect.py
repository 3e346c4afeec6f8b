"""Tell CAN logs from other files of the same suffix, without `python-can`."""

import bz2
import gzip
import lzma
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zstandard

HEAD_BYTES = 1 << 16
# Files of these suffixes are mostly something else: what a CAN log has near its beginning.
MARKS = {
    ".log": re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}#", re.MULTILINE),
    ".asc": re.compile(rb"^\s*(date\s|base\s+(hex|dec)|begin\s+triggerblock)", re.MULTILINE | re.IGNORECASE),
    ".trc": re.compile(rb"^;(\$FILEVERSION|.*PCAN|.*Start time)", re.MULTILINE),
    ".csv": re.compile(rb"\Atimestamp,arbitration_id,extended,remote,error,dlc,data"),
    ".db": re.compile(rb"\ASQLite format 3.*arbitration_id", re.DOTALL),
    ".mdf": re.compile(rb"\AMDF "),
}
SUFFIXES = (".blf", ".mf4", *MARKS)
OPENERS: dict[str, Callable[..., Any]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
    ".zst": zstandard.open,
    ".zstd": zstandard.open,
}
FAULTS = (OSError, EOFError, zlib.error, lzma.LZMAError, zstandard.ZstdError)


def is_can_log(path: Path) -> bool:
    """Whether a file, plain or compressed, is a CAN log by its suffix and first bytes; False if it is unreadable."""
    opener = OPENERS.get(path.suffix.lower(), Path.open)
    suffix = (path if opener is Path.open else path.with_suffix("")).suffix.lower()
    if suffix not in MARKS:
        return suffix in SUFFIXES
    try:
        with opener(path, "rb") as file:
            return MARKS[suffix].search(file.read(HEAD_BYTES)) is not None
    except FAULTS:
        return False
