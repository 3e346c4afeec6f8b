"""Stretches of a kinematic machine's session happen again, with other chances."""

from collections.abc import Sequence

import numpy as np

from benchmarks.closed_loop.kinematic.machine import Machine
from benchmarks.closed_loop.kinematic.session import drive
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import SessionLog

LEAD_S = 3.0
"""Each replay begins so much earlier, at rest: ten of the longest time constants, and the longest dead time."""


class Script:
    """Somebody who does again what was done."""

    def __init__(self, commands: np.ndarray) -> None:
        self._rows = iter(commands)

    def command(self, measured: np.ndarray) -> np.ndarray:
        """See `Driver`."""
        row: np.ndarray = next(self._rows)
        return row


def replay(
    specification: MachineSpecification,
    machine: Machine,
    log: SessionLog,
    starts: Sequence[int],
    horizon: int,
    seed: int,
) -> np.ndarray:
    """See `Simulator.replay`. Its sound machines remember nothing for longer than `LEAD_S`."""
    displacements = []
    lead = round(LEAD_S / specification.dt_s)
    for start, stream in zip(starts, np.random.SeedSequence(seed).spawn(len(starts)), strict=True):
        begin = max(start - lead, 1)  # row k of the true positions is the end of period k
        commands = log.commands[begin : start + horizon]
        minutes = len(commands) * specification.dt_s / 60.0
        start_rad = log.true_positions[begin - 1]
        again = drive(specification, machine, Script(commands), minutes, stream, start_rad=start_rad)
        path_rad = np.concatenate([start_rad[None], again.true_positions])[start - begin :]
        displacements.append(path_rad[1:] - path_rad[0])
    return np.array(displacements)
