"""Stretches of a kinematic machine's session happen again, with other chances."""

from collections.abc import Sequence
from functools import partial

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
    lead = round(LEAD_S / specification.dt_s)
    motion = machine.quantities.motion
    displacements = []
    for start, chances in zip(starts, np.random.SeedSequence(seed).generate_state(len(starts)), strict=True):
        begin = max(start - lead, 1)  # row k of the true positions is the end of period k
        begin_rad, wanted_rad = log.true_positions[begin - 1], log.true_positions[start - 1]
        done = partial(_done_again, specification, machine, log.commands[begin : start + horizon], chances)
        missed_rad = wanted_rad - done(begin_rad)[start - begin]  # it began at rest, and has other chances
        path_rad = done(np.clip(begin_rad + missed_rad, motion.lower_rad, motion.upper_rad))[start - begin :]
        displacements.append(path_rad[1:] - path_rad[0])
    return np.array(displacements)


def _done_again(
    specification: MachineSpecification,
    machine: Machine,
    commands: np.ndarray,
    seed: int,
    start_rad: np.ndarray,
) -> np.ndarray:
    """Positions (len(commands) + 1, n), rad, from `start_rad`, where the machine rests, on."""
    minutes = len(commands) * specification.dt_s / 60.0
    stream = np.random.SeedSequence(seed)
    again = drive(specification, machine, Script(commands), minutes, stream, start_rad=start_rad)
    return np.concatenate([start_rad[None], again.true_positions])
