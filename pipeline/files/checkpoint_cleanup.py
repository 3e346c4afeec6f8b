"""A folder of checkpoints, which the user may have named: a finished run takes its own out of it, and nothing else."""

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from pipeline.files.atomic import PARTIAL_SUFFIX

PARTIAL = re.compile(
    rf"\.(?P<name>.+)\.\d+{re.escape(PARTIAL_SUFFIX)}"
)  # of a file that a kill left half-written


def remove_checkpoints(folder: Path, is_own: Callable[[Path], bool]) -> None:
    """Delete a stage's checkpoints, lest changed code takes up a finished run; then the folder, if it is empty.

    What cannot be deleted stays: the run's results are written.

    Args:
        folder: It may be missing.
        is_own: Whether a file or folder is a checkpoint of the stage, as may be told from its name and what it holds.
    """
    with suppress(OSError):
        for entry in folder.iterdir():
            partial = PARTIAL.fullmatch(entry.name)
            if not is_own(folder / partial["name"] if partial else entry):
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink()
        folder.rmdir()
