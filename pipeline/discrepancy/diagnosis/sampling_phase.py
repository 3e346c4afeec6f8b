"""The phase between command and measurement, which differs from recording to recording.

Whoever records starts its clock at some moment between two ticks of the controller, so that all joints of one log
look late, or early, by the same part of a step. That is no effect on the machine, but it shifts every delay that is
found on a joint; it is estimated once per log, from what most joints agree on, and taken out of the prediction.
"""

import numpy as np

from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation

LARGEST_STEPS = 0.5  # more is not the phase of a recording
BLOCK_ROWS = 400
SMALLEST_EXCITATION = 0.3  # of a joint's mean block: what changes less tells nothing of the moment
AGREEMENT_STEPS = 0.15  # between the joints that count


def sampling_phases(simulation: Simulation, is_used: np.ndarray) -> np.ndarray:
    """(B,) steps by which each log's measurements are late, as far as most of its joints agree; 0 where they do not.

    A log of which no row may be used gets the mean of the others.

    Args:
        simulation: On the logs, with no phases set.
        is_used: (B, T) bool, rows that may be used.
    """
    u = simulation.velocities([NOMINAL])[0]
    velocity, joints = simulation.sequences.velocity, range(u.shape[-1])
    phases = [
        _agreed(np.array([_lateness(velocity[log, rows, j], u[log, rows, j]) for j in joints]))
        if rows.any()
        else None
        for log, rows in enumerate(is_used)
    ]
    known = [phase for phase in phases if phase is not None]
    return np.array([float(np.mean(known)) if phase is None else phase for phase in phases])


def _lateness(velocity: np.ndarray, u: np.ndarray) -> float:
    """Steps by which `velocity` (T,) follows `u` (T,): median over blocks, nan if it hardly changes.

    To first order v(t) = g u(t - l) = g u - g l u', with a factor g of its own per direction.
    """
    change = np.gradient(u) if len(u) > 1 else np.zeros(len(u))
    regressors = np.stack([np.maximum(u, 0.0), np.minimum(u, 0.0), change], axis=1)
    n_blocks = max(1, len(u) // BLOCK_ROWS)
    blocks = list(zip(np.array_split(regressors, n_blocks), np.array_split(velocity, n_blocks), strict=True))
    excitation = np.array([np.sum(a[:, 2] ** 2) for a, _ in blocks])
    found = []
    for (a, v), excited in zip(blocks, excitation, strict=True):
        if excited <= SMALLEST_EXCITATION * excitation.mean():
            continue
        positive, negative, of_change = np.linalg.lstsq(a, v, rcond=None)[0]
        gain = max(positive, negative)
        if gain > 0.0:
            found.append(-of_change / gain)
    return float(np.median(found)) if found else np.nan


def _agreed(late: np.ndarray) -> float:
    """Mean of the half of the joints (two at least) that lie closest together (the shorth), if it can be a phase."""
    late = np.sort(late[np.isfinite(late)])
    n = max(2, -(-len(late) // 2))
    if len(late) < n:
        return 0.0
    begin = int(np.argmin(late[n - 1 :] - late[: len(late) - n + 1]))
    agreeing = late[begin : begin + n]
    phase = float(agreeing.mean())
    return phase if abs(phase) < LARGEST_STEPS and np.ptp(agreeing) < AGREEMENT_STEPS else 0.0
