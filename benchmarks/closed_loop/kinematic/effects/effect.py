"""What an effect of the kinematic machine is, and how its kinds are declared."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.closed_loop.kinematic.machine import JOINTS, NEGATIVE, POSITIVE, Machine
from benchmarks.closed_loop.machines import Variant

N_JOINT = len(JOINTS)
OTHER = "other"

Apply = Callable[[Machine], Machine]


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, as in the contract's `parameters`."""

    value: float
    unit: str


@dataclass(frozen=True)
class Effect:
    """One change of a machine; fields as in `benchmarks.closed_loop.simulator.Effect`."""

    family: str
    kind: str
    joints: tuple[str, ...]
    depends_on: tuple[str, ...]
    truth: dict[str, Quantity]
    cause: str
    apply: Apply


Draw = Callable[[np.random.Generator, Variant, float], Effect]
"""(chances of joint, direction and strength; the machine; size) -> effect."""


@dataclass(frozen=True)
class Kind:
    """A kind of effect.

    Attributes:
        draw: Draws one of a size; 1 is typical.
        largest_size: Physical bound of the size.
    """

    draw: Draw
    largest_size: float


def choose_joint(random: np.random.Generator) -> int:
    """Any joint, evenly."""
    return int(random.integers(N_JOINT))


def choose_two_joints(random: np.random.Generator) -> tuple[int, int]:
    """Any two joints, evenly."""
    first, second = random.choice(N_JOINT, 2, replace=False).tolist()
    return first, second


def choose_sign(random: np.random.Generator) -> int:
    """-1 or 1, evenly."""
    return int(random.choice((-1, 1)))


def side(sign: int) -> int:
    """Index of a direction of motion."""
    return POSITIVE if sign > 0 else NEGATIVE


def with_value(array: np.ndarray, index: int | tuple[int | list[int], ...], value: float) -> np.ndarray:
    """A copy with `value` at `array[index]`."""
    changed = np.array(array)
    changed[index] = value
    return changed
