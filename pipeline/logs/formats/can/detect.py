"""Tell CAN logs from other files of the same suffix, without `python-can`."""

import re
from pathlib import Path

HEAD_BYTES = 1 << 16
# Files of these suffixes are mostly something else: what a CAN log has near its beginning.
MARKS = {
    ".log": re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}#", re.MULTILINE),
    ".asc": re.compile(rb"^\s*(date\s|base\s+(hex|dec)|begin\s+triggerblock)", re.MULTILINE | re.IGNORECASE),
    ".trc": re.compile(rb"^;(\$FILEVERSION|.*PCAN|.*Start time)", re.MULTILINE),
    ".csv": re.compile(rb"\Atimestamp,arbitration_id,extended,remote,error,dlc,data"),
    ".db": re.compile(rb"\ASQLite format 3.*arbitration_id", re.DOTALL),
}
SUFFIXES = (".blf", ".mf4", *MARKS)


def is_can_log(path: Path) -> bool:
    """Whether a file is a CAN log, by its suffix and its first bytes; False if it cannot be read."""
    suffix = path.suffix.lower()
    if suffix not in MARKS:
        return suffix in SUFFIXES
    try:
        with path.open("rb") as file:
            return MARKS[suffix].search(file.read(HEAD_BYTES)) is not None
    except OSError:
        return False
