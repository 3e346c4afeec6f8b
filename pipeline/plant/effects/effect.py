"""An effect: a change of physical quantities of the plant, with its truth in the contract's terms."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pipeline.plant.machines.bobcat_e10 import N_JOINT
from pipeline.plant.parameters import Parameters

Index = int | tuple[int | list[int], ...]


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, as in the contract's `parameters`."""

    value: float
    unit: str


@dataclass(frozen=True)
class PlantEffect:
    """One change of the machine.

    `apply` gives the changed machine; `onset_s` is when it sets in, None if it is there from the start.
    """

    family: str  # of the contract's table
    kind: str  # the file that drew it
    joints: tuple[str, ...]
    depends_on: tuple[str, ...]
    truth: dict[str, Quantity]  # the contract's parameter names where it defines them
    cause: str  # what happened to the machine, in words
    apply: Callable[[Parameters], Parameters]
    onset_s: float | None = None


def choose_joint(random: np.random.Generator) -> int:
    """Any joint, evenly."""
    return int(random.integers(N_JOINT))


def choose_direction(random: np.random.Generator) -> int:
    """-1 or 1, evenly."""
    return int(random.choice((-1, 1)))


def scaled(array: np.ndarray, index: Index, factor: float) -> np.ndarray:
    """A copy with `array[index]` multiplied."""
    changed = np.array(array)
    changed[index] = changed[index] * factor
    return changed


def added(array: np.ndarray, index: Index, amount: float) -> np.ndarray:
    """A copy with `amount` added to `array[index]`."""
    changed = np.array(array)
    changed[index] = changed[index] + amount
    return changed


def replaced(array: np.ndarray, index: Index, value: float) -> np.ndarray:
    """A copy with `value` at `array[index]`."""
    changed = np.array(array)
    changed[index] = value
    return changed


def with_onset(effect: PlantEffect, onset_s: float) -> PlantEffect:
    """The same effect, setting in at `onset_s` after the session's start."""
    return replace(effect, onset_s=onset_s)
