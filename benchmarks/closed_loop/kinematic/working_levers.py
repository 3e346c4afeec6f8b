"""In which poses a machine works: what its nominal sessions show, for truths that are means over poses."""

from functools import cache

import numpy as np

from benchmarks.closed_loop.kinematic.machine import NEGATIVE, POSITIVE
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.kinematic.speed import read_levers
from benchmarks.closed_loop.machines import NOMINAL_MINUTES, Variant
from benchmarks.closed_loop.sessions import machine


@cache
def mean_levers(variant: Variant) -> np.ndarray:
    """Mean levers of a weight at the tip, while each joint is commanded, over the nominal sessions.

    Returns:
        (n, 2) by joint and direction of the command, 1; see `read_levers`.
    """
    levers, commands = [], []
    for seed, minutes in zip(variant.session_seeds, NOMINAL_MINUTES, strict=True):
        log = record_session(
            machine(), variant.parameters, variant.style_seed, minutes, seed, start_time_ns=0
        )
        rows = np.empty_like(log.true_positions)
        for row, position in zip(rows, log.true_positions, strict=True):
            read_levers(position, row)
        levers.append(rows)
        commands.append(log.commands)
    lever, command = np.concatenate(levers), np.concatenate(commands)
    means = np.empty((command.shape[1], 2))
    for side, sign in ((NEGATIVE, -1), (POSITIVE, 1)):
        for joint in range(command.shape[1]):
            means[joint, side] = lever[command[:, joint] == sign, joint].mean()
    return means
