"""The loop tracker over whole trajectories, compiled (definition in `loop_tracker.py`).

The first samples of a process are done in the interpreter: importing the compiler, Numba, takes as long as
`WORTH_COMPILING` of them, so that no run takes more than twice as long as the better way would.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.logs.loop_tracker import LoopTrackerConfig, LoopTrackerState, initial_state

WORTH_COMPILING = 2_000_000  # samples of all joints, at two tenths of a microsecond each


class _Interpreted:
    """How many samples of all joints this process has done in the interpreter."""

    n_samples = 0


def track(q: np.ndarray, dt_s: float, config: LoopTrackerConfig) -> np.ndarray:
    """Estimate the velocities of a whole trajectory; bit for bit equal to `advance` sample by sample.

    Args:
        q: Measured positions at the time step, shape (T, n_joint), rad or m; at least one row.
        dt_s: Time step.
        config: Gains.

    Returns:
        Velocity estimates, shape (T, n_joint), float64, rad/s or m/s.
    """
    q = np.asarray(q, dtype=np.float64)
    return continue_tracking(initial_state(q[0]), q, dt_s, config)[1] if len(q) else np.empty_like(q)


def continue_tracking(
    state: LoopTrackerState, q: np.ndarray, dt_s: float, config: LoopTrackerConfig
) -> tuple[LoopTrackerState, np.ndarray]:
    """Continue a trajectory from a given state; see `track` for the other arguments.

    Returns:
        The state after the last sample, and the velocity estimates, shape (T, n_joint).
    """
    convert: Callable[[np.ndarray], Any] = np.ascontiguousarray
    if _Interpreted.n_samples + q.size < WORTH_COMPILING:
        _Interpreted.n_samples += q.size
        follow: Callable[..., tuple[float, float]] = _follow
        convert = np.ndarray.tolist  # Python's numbers are faster than NumPy's, one by one
    else:
        follow = _compiled()
    q_estimate, integral, velocity = state.q_estimate.copy(), state.integral.copy(), np.empty(q.shape)
    gains = (dt_s, config.proportional_gain, config.integral_gain)
    for joint, positions in enumerate(np.asarray(q, np.float64).T):
        start, rates = (float(q_estimate[joint]), float(integral[joint])), convert(np.empty(len(positions)))
        q_estimate[joint], integral[joint] = follow(*start, convert(positions), rates, *gains)
        velocity[:, joint] = rates
    return LoopTrackerState(q_estimate, integral), velocity


@functools.cache
def _compiled() -> Callable[..., tuple[float, float]]:
    import numba

    try:
        return numba.njit(cache=True)(_follow)
    except RuntimeError:  # no folder for the compiled code can be written
        return numba.njit(_follow)


def _follow(
    q_estimate: float,
    integral: float,
    q: Any,
    velocity: Any,
    dt_s: float,
    proportional_gain: float,
    integral_gain: float,
) -> tuple[float, float]:
    """`advance` sample by sample for one joint: the same IEEE double operations in the same order."""
    for row, position in enumerate(q):
        error = position - q_estimate
        integral += integral_gain * error * dt_s
        q_estimate += dt_s * (proportional_gain * error + integral)
        velocity[row] = integral
    return q_estimate, integral
