"""Validity of commands."""

import numpy as np

from pipeline.machine.specification import CommandKind, MachineSpecification


def is_command(machine: MachineSpecification, values: np.ndarray) -> bool:
    """Whether `values` is a valid command: (n_joint,), in {-1, 0, 1} or in [-1, 1]."""
    values = np.asarray(values)
    if values.shape != (machine.n_joint,) or not np.isfinite(values).all() or np.abs(values).max() > 1.0:
        return False
    return machine.command_kind is CommandKind.continuous or bool((values == np.round(values)).all())
