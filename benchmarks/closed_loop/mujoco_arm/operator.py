"""Who drives an arm: somebody who pushes sticks to some height, holds them and lets go, each joint for itself."""

from dataclasses import dataclass

import numpy as np

from benchmarks.closed_loop.kinematic.operator import RandomHolds, draw_random_style
from pipeline.machine.specification import MachineSpecification

FULL_PROBABILITY = (0.3, 0.7)  # of a hold at full height, by operator; else it is anything from a third on
LEAST_HEIGHT = 0.35
SLEW_1_s = (4.0, 12.0)  # how fast a stick goes


@dataclass
class Sticks:
    """See `kinematic.operator.Driver`."""

    holds: RandomHolds
    random: np.random.Generator
    full_probability: float
    step: float  # of a stick in a control period
    wanted: np.ndarray  # (n,) directions of the present holds
    height: np.ndarray  # (n,)
    present: np.ndarray  # (n,) where the sticks are

    def command(self, measured: np.ndarray) -> np.ndarray:
        """See `Driver`."""
        direction = self.holds.command(measured).astype(np.float64)
        for joint in np.flatnonzero(direction != self.wanted):
            is_full = self.random.random() < self.full_probability
            self.height[joint] = 1.0 if is_full else self.random.uniform(LEAST_HEIGHT, 1.0)
        self.wanted = direction
        step = np.clip(direction * self.height - self.present, -self.step, self.step)
        self.present = self.present + step
        return self.present


def sticks(machine: MachineSpecification, style_seed: int, seed: int) -> Sticks:
    """An operator.

    Args:
        machine: Limits and rate.
        style_seed: Of habits.
        seed: Of choices.
    """
    style = np.random.default_rng([style_seed, 1])
    hold_seed, height_seed = np.random.SeedSequence(seed).generate_state(2).tolist()
    n = machine.n_joint
    return Sticks(
        RandomHolds(machine, draw_random_style(style_seed), hold_seed),
        np.random.default_rng(height_seed),
        style.uniform(*FULL_PROBABILITY),
        style.uniform(*SLEW_1_s) * machine.dt_s,
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
    )
