"""Identity and liveness of a run's process: a killed process cannot end its own run."""

import contextlib
import os
import socket
from pathlib import Path

import psutil


def identity(process: psutil.Process) -> str:
    """Unique identity of a process, also against a later one with the same number."""
    return f"{process.pid}-{process.create_time():.2f}@{socket.gethostname()}"


def own_identity() -> str:
    """Identity of this process."""
    return identity(psutil.Process())


def is_known_dead(process: str) -> bool:
    """Whether the process has certainly ended; always False for another computer."""
    if not process.endswith(f"@{socket.gethostname()}"):
        return False
    try:
        return identity(psutil.Process(int(process.split("-")[0]))) != process
    except psutil.Error:
        return True


def dvc_process() -> str | None:
    """The `dvc` process that started this stage, or None outside DVC."""
    if "DVC_STAGE" not in os.environ:
        return None
    for ancestor in psutil.Process().parents():
        with contextlib.suppress(psutil.Error):
            if any(Path(word).name == "dvc" for word in ancestor.cmdline()[:3]):
                return identity(ancestor)
    return None
