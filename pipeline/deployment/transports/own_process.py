"""What joins a ROS graph in a process of its own: rospy joins one in a process's life."""

import ctypes
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
PR_SET_PDEATHSIG = 1  # of prctl(2)


def in_own_process(function: Callable[P, R], *arguments: P.args, **keys: P.kwargs) -> R:
    """Call it there; what it takes and returns, or raises, is pickled."""
    with ProcessPoolExecutor(1, get_context("spawn"), _die_with_parent) as process:
        return process.submit(function, *arguments, **keys).result()


def _die_with_parent() -> None:
    """Or else a graph would go on driving the machine after its command was killed."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
