"""From the angles to the readings: sampling, latency, mounting, noise, quantisation."""

import numpy as np

from benchmarks.closed_loop.kinematic.machine import Encoder
from benchmarks.closed_loop.unstored import compiled


@compiled
def read_encoders(
    encoder: Encoder,
    path_rad: np.ndarray,
    substep_s: float,
    stamp_s: np.ndarray,
    age_draw: np.ndarray,
    noise_draw: np.ndarray,
    n_read: int,
    until_s: float,
    readings_rad: np.ndarray,
) -> int:
    """Take the readings whose stamps are due; between substeps the path is linear.

    Args:
        encoder: Of the machine.
        path_rad: (K, n) true joint angles at multiples of the substep, from the session's start.
        substep_s: Length of a substep.
        stamp_s: (N,) stamps of the session, ascending.
        age_draw: (N,) even in [-1, 1].
        noise_draw: (N, n) standard normal.
        n_read: How many readings were taken before.
        until_s: Time up to which the path is known.
        readings_rad: (N, n), written from row `n_read` on.

    Returns:
        How many readings are taken now.
    """
    while n_read < stamp_s.size and stamp_s[n_read] <= until_s:
        age_s = encoder.latency_s + encoder.latency_jitter_s * age_draw[n_read]
        place = max(stamp_s[n_read] - age_s, 0.0) / substep_s
        row = min(int(place), path_rad.shape[0] - 2)
        share = place - row
        for j in range(path_rad.shape[1]):
            angle = path_rad[row, j] + share * (path_rad[row + 1, j] - path_rad[row, j])
            angle = encoder.scale[j] * angle + encoder.offset_rad[j]
            angle += encoder.noise_std_rad * noise_draw[n_read, j]
            readings_rad[n_read, j] = np.round(angle / encoder.quantum_rad) * encoder.quantum_rad
        n_read += 1
    return n_read
