"""Logged rows as padded sequences on the device, for everything that runs along whole logs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.logs.tuples import Trajectory


class Sequences(NamedTuple):
    """Trajectories side by side, padded at the end to equal length; B trajectories, T rows.

    Attributes:
        command: (B, T, n_joint), a_t.
        q: (B, T, n_joint), rad or m.
        velocity: (B, T, n_joint), displacement from row t to t+1 per time step, rad/s or m/s; 0 in padding.
        time_s: (B, T), since the start of the log.
        stamp_ns: (B, T), int64, absolute.
        is_row: (B, T), bool, where velocity is measured, and the commands before it are known.
        channels: (B, T, n_channel), each in its own unit, NaN where none holds.
    """

    command: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    time_s: np.ndarray
    stamp_ns: np.ndarray
    is_row: np.ndarray
    channels: np.ndarray = np.zeros((1, 1, 0))


LENGTH_QUANTUM = 1024  # rows: logs of similar length share one compilation


def side_by_side(
    trajectories: Sequence[Trajectory], dt_s: float, history_rows: int, channels: Sequence[str] = ()
) -> Sequences:
    """Pad trajectories to equal length.

    Args:
        trajectories: One at least.
        dt_s: Length of one time step.
        history_rows: At the start of each that are no rows, as nobody knows which commands came before them: what was
            cut by a gap begins anywhere in a motion.
        channels: Names of the machine's channels; a log may lack some.
    """
    longest = max(len(trajectory) for trajectory in trajectories)
    n_rows = -(-longest // LENGTH_QUANTUM) * LENGTH_QUANTUM
    columns: dict[str, list[np.ndarray]] = {name: [] for name in Sequences._fields}
    for trajectory in trajectories:
        padding = n_rows - len(trajectory)
        velocity = np.diff(trajectory.q, axis=0) / dt_s
        columns["command"].append(np.pad(trajectory.a, ((0, padding), (0, 0))))
        columns["q"].append(np.pad(trajectory.q, ((0, padding), (0, 0)), mode="edge"))
        columns["velocity"].append(np.pad(velocity, ((0, padding + 1), (0, 0))))
        columns["time_s"].append(np.pad(trajectory.t_s, (0, padding), mode="edge"))
        columns["stamp_ns"].append(np.pad(trajectory.stamp_ns, (0, padding), mode="edge"))
        unknown = np.full(len(trajectory), np.nan)
        x = np.array([trajectory.channels.get(name, unknown) for name in channels])
        x = x.reshape(len(channels), len(trajectory)).T
        columns["channels"].append(np.pad(x, ((0, padding), (0, 0)), mode="edge"))
        row = np.arange(n_rows)
        columns["is_row"].append((row >= history_rows) & (row < len(trajectory) - 1))
    return Sequences(**{name: np.stack(arrays) for name, arrays in columns.items()})
