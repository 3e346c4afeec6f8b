"""Identity of a worker process, from which others can tell whether it still runs."""

import contextlib
import os
import socket

import psutil

_SEPARATOR = "@"


def own_identity() -> str:
    """Process number, start time and computer: unique over all computers."""
    return _identity(psutil.Process())


def is_known_dead(identity: str) -> bool:
    """Whether the process has certainly ended; always False for another computer."""
    if not identity.endswith(f"{_SEPARATOR}{_computer()}"):
        return False
    with contextlib.suppress(psutil.Error, ValueError):
        process = psutil.Process(int(identity.split("-")[0]))
        return _identity(process) != identity or process.status() == psutil.STATUS_ZOMBIE
    return True


def _identity(process: psutil.Process) -> str:
    return f"{process.pid}-{process.create_time():.2f}{_SEPARATOR}{_computer()}"


def _computer() -> str:
    # Containers of one computer may share its name, but not its process numbers.
    with contextlib.suppress(OSError):
        return f"{socket.gethostname()}/{os.readlink('/proc/self/ns/pid')}"
    return socket.gethostname()
