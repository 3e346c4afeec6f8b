"""The noise floor of joints at rest, which is far below that in motion, where the diagnosis model's misfit is."""

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import averaged
from pipeline.effects.effect import SMALLEST_COMMAND

SETTLED_S = 0.5  # since the last command, after which a joint stands


def floor_at_rest(
    residual: np.ndarray, command: np.ndarray, is_used: np.ndarray, floor: np.ndarray, dt_s: float
) -> np.ndarray:
    """Mean square of the residual at rest, in units of that of all rows: (n_joint,), at most 1.

    Args:
        residual: (N, n_joint) of nominal logs, averaged.
        command: (B, T, n_joint).
        is_used: (B, T) bool.
        floor: (n_joint,) mean square of the residual.
        dt_s: Time step.
    """
    rows, n_rows = round(SETTLED_S / dt_s), command.shape[1]
    is_resting = np.zeros(command.shape, bool)
    commanded = np.concatenate(
        [
            np.zeros((len(command), 1, command.shape[2])),
            np.cumsum(np.abs(command) >= SMALLEST_COMMAND, axis=1),
        ],
        axis=1,
    )
    if n_rows >= rows:
        is_resting[:, rows - 1 :] = commanded[:, rows:] == commanded[:, : n_rows + 1 - rows]
    resting = averaged(is_resting.astype(float), is_used) > 0.999
    squares = np.sum(resting * residual**2, axis=0) / np.maximum(resting.sum(axis=0), 1)
    return np.where(resting.any(axis=0), np.minimum(squares / floor, 1.0), 1.0)
