"""A function in a process of its own: what it returns or raises comes back, and it dies with its command."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.deployment.transports.own_process import in_own_process
from pipeline.errors import InputError

PATIENCE_S = 60.0


def refuse(said: str) -> None:
    raise InputError(said)


def test_what_it_returns_or_raises_comes_back() -> None:
    assert in_own_process(os.getpid) != os.getpid()
    with pytest.raises(InputError, match="no master came up"):
        in_own_process(refuse, "no master came up")


def test_it_dies_with_the_command_that_was_killed() -> None:
    work = "import os, time; print(os.getpid(), flush=True); time.sleep(1000)"
    code = f"from pipeline.deployment.transports.own_process import in_own_process; in_own_process(exec, {work!r})"
    command = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert command.stdout is not None
    worker = Path(f"/proc/{int(command.stdout.readline())}")
    assert worker.exists()
    command.kill()
    command.wait()
    deadline = time.monotonic() + PATIENCE_S
    while worker.exists() and "Z" not in (worker / "stat").read_text().rpartition(")")[2]:
        assert time.monotonic() < deadline
        time.sleep(0.05)
