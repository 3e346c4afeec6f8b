"""From numbers in a log to positions and commands: scale × number + offset, then the threshold of discrete commands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import CommandKind, MachineSpecification


def discretise(value: np.ndarray, threshold: float) -> np.ndarray:
    """Turn stick deflections in [-1, 1] into -1, 0, 1: full command beyond ±threshold, else zero; NaN stays.

    Source: the paper's joystick interpreter, with the rule of its proto-actions (eq. proto_discretization).
    """
    return np.where(np.abs(value) <= threshold, 0.0, np.sign(value))


@dataclass(frozen=True)
class Conversion:
    """Conversion of one stream.

    Attributes:
        scale: Per joint, shape (n_joint,); None for 1.
        offset: Likewise, in the unit of the result; None for 0.
        threshold: Of discrete commands.
    """

    scale: np.ndarray | None = None
    offset: np.ndarray | None = None
    threshold: float | None = None

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """Convert numbers as recorded, shape (n, n_joint); damaged ones may overflow to infinity."""
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = numbers if self.scale is None else numbers * self.scale
            value = scaled if self.offset is None else scaled + self.offset
        return value if self.threshold is None else discretise(value, self.threshold)

    def recorded(self, values: np.ndarray) -> np.ndarray:
        """Return the numbers that convert to given values, shape (n, n_joint)."""
        shifted = values if self.offset is None else values - self.offset
        return shifted if self.scale is None else shifted / self.scale

    def recorded_rates(self, rates: np.ndarray) -> np.ndarray:
        """Return the rates of change of recorded numbers from those of values per second, shape (n, n_joint)."""
        return rates if self.scale is None else rates / self.scale


def position_conversion(machine: MachineSpecification) -> Conversion:
    """Return the conversion of the machine's positions.

    Raises:
        InputError: The configuration lists another number of values than the machine has joints, or a scale of zero.
    """
    source = machine.joint_states
    return Conversion(*_scale_and_offset(source.scale, source.offset, machine, "joint_states"))


def command_conversion(machine: MachineSpecification) -> Conversion:
    """Return the conversion of the machine's commands; errors as for `position_conversion`."""
    source = machine.commands
    threshold = source.threshold if machine.command_kind == CommandKind.discrete else None
    return Conversion(*_scale_and_offset(source.scale, source.offset, machine, "commands"), threshold)


def _scale_and_offset(
    scale: Sequence[float], offset: Sequence[float], machine: MachineSpecification, section: str
) -> tuple[np.ndarray | None, np.ndarray | None]:
    place = f"conf/machine/{machine.name}.yaml: {section}"
    parts = []
    for key, listed in (("scale", scale), ("offset", offset)):
        if listed and len(listed) not in (1, machine.n_joint):
            raise InputError(
                f"{place}.{key} has {len(listed)} entries; list one per joint ({machine.n_joint}), or one for all"
            )
        parts.append(np.broadcast_to(np.array(listed, np.float64), machine.n_joint) if listed else None)
    if 0 in scale:
        raise InputError(f"{place}.scale holds 0, which would lose all values")
    return parts[0], parts[1]
