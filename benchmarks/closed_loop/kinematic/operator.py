"""Who drives a kinematic machine: the plant's painting operator, or one who holds sticks at random."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from benchmarks.closed_loop.kinematic.machine import Work
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.operator import ScriptedOperator, draw_style

STOP_PROBABILITY = 0.75  # after a hold; else another may follow at once, which makes reversals without rest
MIDDLE_SHARES = (0.05, 0.95)  # of the range, at which the choice of direction is as uneven as it gets
HOLD_SHAPE = 2.0  # of the gamma distribution of holds
SHORTEST_S = 0.1  # of holds and pauses


class Driver(Protocol):
    """Somebody at the sticks."""

    def command(self, measured: np.ndarray) -> np.ndarray:
        """Commands, (n,) in {-1, 0, 1}, for the newest joint angles, (n,), rad; called once per control period."""
        ...


@dataclass(frozen=True)
class RandomStyle:
    """Habits of one random operator."""

    start_probability: float  # when a pause is over; else another one follows
    mean_hold_s: float
    mean_pause_s: float


def draw_random_style(seed: int) -> RandomStyle:
    """Habits, drawn by seed."""
    random = np.random.default_rng(seed)
    return RandomStyle(
        start_probability=random.uniform(0.25, 0.5),
        mean_hold_s=random.uniform(0.8, 1.8),
        mean_pause_s=random.uniform(0.5, 2.0),
    )


class RandomHolds:
    """Holds each joint's stick for a random time, sooner back to the middle of the range than away from it."""

    def __init__(self, machine: MachineSpecification, style: RandomStyle, seed: int) -> None:
        self._style = style
        self._random = np.random.default_rng(seed)
        self._lower, self._span = machine.lower, machine.upper - machine.lower
        self._dt_s = machine.dt_s
        self._command = np.zeros(machine.n_joint, dtype=np.int8)
        self._left_s = np.zeros(machine.n_joint)

    def command(self, measured: np.ndarray) -> np.ndarray:
        """See `Driver`."""
        self._left_s -= self._dt_s
        share = np.clip((measured - self._lower) / self._span, *MIDDLE_SHARES)
        for joint in np.flatnonzero(self._left_s <= 0.0).tolist():
            self._decide(joint, float(share[joint]))
        return self._command.copy()

    def _decide(self, joint: int, share: float) -> None:
        """The next hold or pause of one joint that stands at `share` of its range."""
        random, style = self._random, self._style
        stops = self._command[joint] != 0 and random.random() < STOP_PROBABILITY
        if stops or random.random() > style.start_probability:
            self._command[joint] = 0
            self._left_s[joint] = SHORTEST_S + random.exponential(style.mean_pause_s)
        else:
            self._command[joint] = 1 if random.random() > share else -1
            self._left_s[joint] = SHORTEST_S + random.gamma(HOLD_SHAPE, style.mean_hold_s / HOLD_SHAPE)


def driver(machine: MachineSpecification, work: Work, style_seed: int, seed: int) -> Driver:
    """Who does that work.

    Args:
        machine: Names, limits, rate, workspace.
        work: What the machine is used for.
        style_seed: Of habits.
        seed: Of choices.
    """
    if work is Work.painting:
        return ScriptedOperator(machine, draw_style(style_seed), seed)
    return RandomHolds(machine, draw_random_style(style_seed), seed)
