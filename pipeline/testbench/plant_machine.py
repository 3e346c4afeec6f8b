"""The plant in the machine's place, behind a driver of the graph."""

import math
from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.drivers.machine import Sample
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.parameters import Parameters
from pipeline.plant.sealed.undeclared import draw_effects
from pipeline.plant.simulator import Plant

PERIOD_S = 0.01  # at which the plant is advanced: commands act within so much of their arrival


class PlantMachine:
    """The plant behind a driver: encoder readings at their own rate, no velocities."""

    def __init__(self, parameters: Parameters, seed: int, start: np.ndarray) -> None:
        """A plant at rest in `start`, (n_joint,), rad; it takes commands every `PERIOD_S`."""
        numerics = parameters.numerics._replace(control_period_s=PERIOD_S)
        self._plant = Plant(parameters._replace(numerics=numerics), seed, start)

    @property
    def period_ns(self) -> int:
        """Length of one period."""
        return nanoseconds(PERIOD_S)

    def read(self) -> Sequence[Sample]:
        """Nothing yet: the encoders' first readings come with the first periods."""
        return ()

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """One period."""
        states = self._plant.step(np.asarray(command)).joint_states
        ages_ns = np.maximum(np.round((self._plant.time_s - states.stamp_s) * NANOSECONDS), 0).astype(int)
        return [Sample(int(age), q, None) for age, q in zip(ages_ns, states.position_rad, strict=True)]


def changed_machine(name: str, effects: Sequence[str], seed: int, size: float) -> Parameters:
    """The machine with the effects named, all of which have set in: drawn as `record_changed` draws them."""
    parameters = simulated_machine(name)
    for effect in draw_effects(effects, seed, parameters, size, math.inf):
        parameters = effect.apply(parameters)
    return parameters
