"""The machine's time grid: positions by linear interpolation, commands by causal zero-order hold."""

from dataclasses import dataclass

import numpy as np

from pipeline.logs.raw_log import NANOSECONDS


@dataclass(frozen=True)
class GridSegment:
    """A stretch of log without gaps, on the machine's grid.

    Attributes:
        stamp_ns: Time of each row, shape (T,), int64.
        q: Positions, shape (T, n_joint), float64, rad or m.
        a: Command in force at each row, shape (T, n_joint), float64.
    """

    stamp_ns: np.ndarray
    q: np.ndarray
    a: np.ndarray


def resample(
    joint_time_ns: np.ndarray,
    q: np.ndarray,
    command_time_ns: np.ndarray,
    command: np.ndarray,
    dt_s: float,
    maximum_gap_s: float,
) -> list[GridSegment]:
    """Put a log on the grid (contract, section 2).

    Rows start at the first joint sample at or after the first command and follow every `dt_s` as long as
    joint samples last. Between joint samples further apart than `maximum_gap_s` nothing is interpolated: a
    new segment, with a grid of its own, starts at the sample after the gap.

    Args:
        joint_time_ns: Time of each joint sample, shape (N,), int64, strictly ascending.
        q: Positions, shape (N, n_joint), rad or m.
        command_time_ns: Time of each command, shape (M,), int64, ascending.
        command: Commands, shape (M, n_joint).
        dt_s: Time step of the grid.
        maximum_gap_s: Longest gap that is interpolated.

    Returns:
        Segments of at least one row, in time order; none if no joint sample follows a command.
    """
    if len(command_time_ns) == 0:
        return []
    first = int(np.searchsorted(joint_time_ns, command_time_ns[0], side="left"))
    time_ns, q = joint_time_ns[first:], q[first:]
    if len(time_ns) == 0:
        return []
    starts = np.flatnonzero(np.diff(time_ns) > maximum_gap_s * NANOSECONDS) + 1
    pieces = zip(np.split(time_ns, starts), np.split(q, starts), strict=True)
    return [_grid(piece_ns, piece_q, command_time_ns, command, dt_s) for piece_ns, piece_q in pieces]


def _grid(
    time_ns: np.ndarray, q: np.ndarray, command_time_ns: np.ndarray, command: np.ndarray, dt_s: float
) -> GridSegment:
    step_ns = round(dt_s * NANOSECONDS)
    stamp_ns = np.arange(time_ns[0], time_ns[-1] + 1, step_ns, dtype=np.int64)
    # Times relative to the segment's start are exact in float64; absolute nanoseconds are not.
    since_start, sampled = (
        (stamp_ns - time_ns[0]).astype(np.float64),
        (time_ns - time_ns[0]).astype(np.float64),
    )
    on_grid = np.stack([np.interp(since_start, sampled, q[:, joint]) for joint in range(q.shape[1])], axis=1)
    in_force = np.searchsorted(command_time_ns, stamp_ns, side="right") - 1
    return GridSegment(stamp_ns, on_grid, command[in_force])
