"""Two policies on the machine: their trials in logs, target by target."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.control.repair.comparison import Comparison
from pipeline.errors import InputError
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.trajectories import load_logs
from pipeline.reaching.logged_trials import LoggedTrial, logged_trials, trial_traces
from pipeline.reaching.settings import ReachingSettings

DECIMALS = 6  # of a pose, m and 1: a target that was sent twice is the same but for rounding


def compare_logged(
    former: Path, new: Path, reaching: ReachingSettings, ingest: IngestConfig, loop_tracker: LoopTrackerConfig
) -> Comparison:
    """Compare the trials in two folders of logs over the targets that both pursued; a repeated one counts repeatedly.

    Raises:
        InputError: A folder holds no usable logs, or they have no target in common.
    """
    of_former, of_new = (
        _by_target(trials_in(folder, reaching, ingest, loop_tracker)) for folder in (former, new)
    )
    pairs = [
        pair
        for target, trials in of_former.items()
        for pair in zip(trials, of_new.get(target, ()), strict=False)
    ]
    if not pairs:
        raise InputError(f"{new}: has no target in common with {former}; pursue the same targets with both")
    traces = (trial_traces(trials, reaching.machine, reaching.arm) for trials in zip(*pairs, strict=True))
    return Comparison.of(*traces)


def trials_in(
    folder: Path, reaching: ReachingSettings, ingest: IngestConfig, loop_tracker: LoopTrackerConfig
) -> list[LoggedTrial]:
    """All trials in a folder of logs, in time order."""
    return [
        trial
        for log in load_logs(folder, reaching.machine, ingest, loop_tracker)
        if log.targets is not None
        for trial in logged_trials(log.trajectories, log.targets, reaching.episodes.steps)
    ]


def _by_target(trials: Sequence[LoggedTrial]) -> dict[tuple, list[LoggedTrial]]:
    found: dict[tuple, list[LoggedTrial]] = defaultdict(list)
    for trial in trials:
        pose = np.concatenate([trial.position, trial.quaternion])
        found[tuple(np.round(pose, DECIMALS))].append(trial)
    return found
