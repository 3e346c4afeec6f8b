"""Stretches of a session happen again: the same state and commands, other chances."""

from collections.abc import Sequence
from typing import Any, Protocol, Self

import numpy as np


class Run(Protocol):
    """A machine that is driven, period by period."""

    def advance(self, period: int, command: np.ndarray, machine: Any) -> Any:
        """Run one control period."""
        ...

    def twin(self, period: int, horizon: int, seed: int) -> Self:
        """The same state at the begin of a period, for `horizon` periods more with other chances."""
        ...

    def positions(self, first: int, last: int) -> np.ndarray:
        """(last - first + 1, n) true positions at the begins of periods `first` to `last`, rad or m."""
        ...


def at_time(machine: Any, changes: Sequence[tuple[float, Any]], time_s: float) -> Any:
    """The machine that holds at a time, given later ones with the times from which on they do."""
    return [machine, *(later for begin_s, later in changes if time_s >= begin_s)][-1]


def replay(
    run: Run,
    commands: np.ndarray,
    machine: Any,
    changes: Sequence[tuple[float, Any]],
    starts: Sequence[int],
    horizon: int,
    seed: int,
    period_s: float,
    instead: Sequence[Any],
) -> np.ndarray:
    """See `Simulator.replay`; `run` is the session at its start."""
    seeds = np.random.SeedSequence(seed).generate_state(len(starts) * len(instead)).reshape(len(instead), -1)
    displacements: list[list[np.ndarray]] = [[] for _ in instead]
    present = 0
    for number, start in enumerate(starts):
        for period in range(present, start):
            run.advance(period, commands[period], at_time(machine, changes, period * period_s))
        present = start
        for twin_number, other in enumerate(instead):
            twin = run.twin(start, horizon, int(seeds[twin_number, number]))
            for period in range(start, start + horizon):
                that = at_time(machine, changes, period * period_s) if other is None else other
                twin.advance(period, commands[period], that)
            path = twin.positions(start, start + horizon)
            displacements[twin_number].append(path[1:] - path[0])
    return np.array(displacements)
