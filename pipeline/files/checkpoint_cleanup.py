"""Clean-up of checkpoints: a finished run deletes its own and leaves everything else in the user's folder."""

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from pipeline.files.atomic import PARTIAL_SUFFIX

PARTIAL = re.compile(
    rf"\.(?P<name>.+)\.\d+{re.escape(PARTIAL_SUFFIX)}"
)  # files that a killed process left incomplete


def remove_checkpoints(folder: Path | None, is_own: Callable[[Path], bool]) -> None:
    """Delete a stage's checkpoints, so that changed code cannot resume a finished run; then the folder if empty.

    Deletion errors are ignored, because the run's results have been written.

    Args:
        folder: It may be missing, or None where a run keeps no checkpoints.
        is_own: Whether a file or folder is a checkpoint of the stage, by its name and content.
    """
    if folder is None:
        return
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
