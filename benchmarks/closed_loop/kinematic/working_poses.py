"""In which poses a machine works: what its nominal sessions show, for effects and truths that are relative to them."""

from functools import cache

import numpy as np

from benchmarks.closed_loop.kinematic.machine import NEGATIVE, POSITIVE
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.kinematic.speed import read_levers
from benchmarks.closed_loop.machines import NOMINAL_MINUTES, Variant
from benchmarks.closed_loop.sessions import machine


@cache
def working_poses(variant: Variant) -> tuple[np.ndarray, np.ndarray]:
    """Positions, rad, and commands of the nominal sessions, (T, n) each."""
    logs = [
        record_session(machine(), variant.parameters, variant.style_seed, minutes, seed, start_time_ns=0)
        for seed, minutes in zip(variant.session_seeds, NOMINAL_MINUTES, strict=True)
    ]
    return (
        np.concatenate([log.true_positions for log in logs]),
        np.concatenate([log.commands for log in logs]),
    )


@cache
def mean_levers(variant: Variant) -> np.ndarray:
    """Mean levers of a weight at the tip, while each joint is commanded.

    Returns:
        (n, 2) by joint and direction of the command, 1; see `read_levers`.
    """
    positions, command = working_poses(variant)
    lever = np.empty_like(positions)
    for row, position in zip(lever, positions, strict=True):
        read_levers(position, row)
    means = np.empty((command.shape[1], 2))
    for side, sign in ((NEGATIVE, -1), (POSITIVE, 1)):
        for joint in range(command.shape[1]):
            means[joint, side] = lever[command[:, joint] == sign, joint].mean()
    return means


def place_within_work(variant: Variant, joint: int, moving: int, share: float) -> float:
    """Where a joint is beyond, rad, for all but that share of the time in which another joint is commanded."""
    positions, command = working_poses(variant)
    return float(np.quantile(positions[command[:, moving] != 0, joint], share))
