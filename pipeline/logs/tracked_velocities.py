"""The loop tracker over whole trajectories, compiled (definition in `loop_tracker.py`).

The first samples of a process are done in the interpreter: importing the compiler, Numba, takes as long as
`WORTH_COMPILING` of them, so that no run takes more than twice as long as the better way would.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.logs.loop_tracker import LoopTrackerConfig, LoopTrackerState, initial_state

WORTH_COMPILING = 200_000  # samples of all joints, at some microseconds each


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
    q_estimate, integral = state.q_estimate.copy(), state.integral.copy()
    velocity = np.empty(q.shape)
    arrays: tuple[Any, ...] = (q_estimate, integral, np.ascontiguousarray(q, np.float64), velocity)
    numbers = (dt_s, config.proportional_gain, config.integral_gain)
    if _Interpreted.n_samples + q.size < WORTH_COMPILING:
        _Interpreted.n_samples += q.size
        # A view's items are Python's numbers, which are faster than NumPy's.
        views: tuple[Any, ...] = tuple(memoryview(array) for array in arrays)
        interpreted: Callable[..., None] = _track
        interpreted(*views, *numbers)
    else:
        _compiled()(*arrays, *numbers)
    return LoopTrackerState(q_estimate, integral), velocity


@functools.cache
def _compiled() -> Callable[..., None]:
    import numba

    try:
        return numba.njit(cache=True)(_track)
    except RuntimeError:  # no folder for the compiled code can be written
        return numba.njit(_track)


def _track(
    q_estimate: Any,
    integral: Any,
    q: Any,
    velocity: Any,
    dt_s: float,
    proportional_gain: float,
    integral_gain: float,
) -> None:
    """`advance` sample by sample, in place: the same IEEE double operations in the same order."""
    for row in range(q.shape[0]):
        for joint in range(q.shape[1]):
            error = q[row, joint] - q_estimate[joint]
            integral[joint] += integral_gain * error * dt_s
            q_estimate[joint] += dt_s * (proportional_gain * error + integral[joint])
            velocity[row, joint] = integral[joint]
