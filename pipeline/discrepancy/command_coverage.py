"""Commands of the measured logs that the nominal logs hardly hold: there the model extrapolates."""

import numpy as np

PARTS = 20  # of [-1, 1]
SMALLEST_COMMAND = 1e-3
SELDOM_SHARE = 0.01  # of the nominal rows on which the joint is commanded, per part


def uncovered_share(nominal: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Per joint, the share of measured commands that lie where nominal logs seldom command it.

    Args:
        nominal: (N, n_joint) proportional commands in [-1, 1].
        measured: (M, n_joint).

    Returns:
        (n_joint,) of the measured rows on which the joint is commanded; 0 where there are none.
    """
    shares = np.zeros(nominal.shape[1])
    for joint in range(nominal.shape[1]):
        known, asked = (
            _part(commands[:, joint][np.abs(commands[:, joint]) > SMALLEST_COMMAND])
            for commands in (nominal, measured)
        )
        if len(asked):
            seldom = np.bincount(known, minlength=PARTS) < max(SELDOM_SHARE * len(known), 1)
            shares[joint] = float(np.mean(seldom[asked]))
    return shares


def _part(command: np.ndarray) -> np.ndarray:
    return np.clip(np.floor(0.5 * (command + 1.0) * PARTS), 0, PARTS - 1).astype(int)
