"""Jobs of a sweep that join a ROS graph each."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from pipeline.deployment.transports.own_process import in_own_process

P = ParamSpec("P")
R = TypeVar("R")


def for_this_job(function: Callable[P, R], *arguments: P.args, **keys: P.kwargs) -> R:
    """Call it in a process of its own where this one has more jobs to do: in a sweep."""
    is_sweep = HydraConfig.get().mode is RunMode.MULTIRUN
    return in_own_process(function, *arguments, **keys) if is_sweep else function(*arguments, **keys)
