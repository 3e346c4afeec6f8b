"""The plant in the machine's place, behind a driver of the graph."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.drivers.machine import Sample
from pipeline.plant.machines.field import Shift
from pipeline.plant.machines.simulated import Condition, simulated_machine
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.session import read_moment
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

    @property
    def contacts(self) -> int:
        """How often the tip met the ground or the machine's base."""
        return int(self._plant.state.contacts[0])

    def read(self) -> Sequence[Sample]:
        """Nothing yet: the encoders' first readings come with the first periods."""
        return ()

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """One period."""
        states = self._plant.step(np.asarray(command)).joint_states
        ages_ns = np.maximum(np.round((self._plant.time_s - states.stamp_s) * NANOSECONDS), 0).astype(int)
        return [Sample(int(age), q, None) for age, q in zip(ages_ns, states.position_rad, strict=True)]


def changed_parameters(
    machine: str, effects: Sequence[str], seed: int, size: float, condition: Condition, plant_seed: int
) -> Parameters:
    """Of the plant with effects that have all set in, drawn as `record_changed` draws them.

    In the field, `plant_seed` draws what differs from start to start of its engine.

    Raises:
        InputError: There is no plant of this machine, or no such effect.
    """
    parameters = simulated_machine(machine, condition)
    for effect in draw_effects(effects, seed, parameters, size, math.inf):
        parameters = effect.apply(parameters)
    if condition is Condition.workshop:
        return parameters
    return Shift((), plant_seed).started(parameters, 1)


@dataclass(kw_only=True)
class ChangedPlant:
    """The plant of `changed_parameters`, at a moment.

    Attributes:
        start_time: Of the first bag, with zone.
        plant_seed: Of the plant's process variation and its encoders' noise.
        effects: Kinds of the effects.
        effects_seed: Of their values.
        effect_size: Factor on them.
        condition: Of the plant.
    """

    start_time: str
    plant_seed: int
    effects: list[str] = field(default_factory=list)
    effects_seed: int
    effect_size: float
    condition: Condition

    def start(self) -> datetime:
        """Raises `InputError` where `start_time` is no time with a zone."""
        return read_moment("start_time", self.start_time)

    def parameters(self, machine: str, session: int = 0) -> Parameters:
        """Those of the machine of this name in a session, with the effects; raises as `changed_parameters`."""
        draw = self.effects, self.effects_seed, self.effect_size
        return changed_parameters(machine, *draw, self.condition, self.plant_seed + session)
