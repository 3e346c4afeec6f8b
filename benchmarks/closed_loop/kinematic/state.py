"""What the kinematic machine remembers from one substep to the next, as arrays that compiled code changes in place."""

from typing import NamedTuple

import numpy as np

N_SHARED = 2
"""Processes that all joints share, in front of those of single joints in `State.process`."""
SLOW, SUPPLY = range(N_SHARED)


class State(NamedTuple):
    """Everything that is remembered."""

    arrived_period: (
        np.ndarray
    )  # (n,) int64, number of the control period whose command the valve has; -1: none yet
    arrived: np.ndarray  # (n,) that command, in {-1, 0, 1}
    held_s: np.ndarray  # (n,) since it last changed
    rest_s: np.ndarray  # (n,) since the valve closed and the drive stood still
    stuck_s: np.ndarray  # (n,) for how much longer the valve sticks
    sign: np.ndarray  # (n,) of the last command that was not zero
    locked_s: np.ndarray  # (n,) for how much longer the valve is locked out
    valve: np.ndarray  # (n,) what the valve does of the command
    process: np.ndarray  # (N_SHARED + n,) Ornstein-Uhlenbeck processes of unit variance
    activity: np.ndarray  # (1,) mean |valve|, averaged over the recent past, 1: typical
    travel_rad: np.ndarray  # (n,) way gone
    drive_rad_s: np.ndarray  # (n,) speed behind the nominal dynamics
    lagged_rad_s: np.ndarray  # (n,) behind the added lag
    ringing_rad_s: np.ndarray  # (n,) behind the resonance
    ringing_rad_s2: np.ndarray  # (n,) its derivative
    drive_rad: np.ndarray  # (n,) position on the drive's side of the play
    link_rad: np.ndarray  # (n,) on the link's side: the true joint angle


LONG_REST_S = 60.0  # of a machine that stands when the session begins


def resting_state(position_rad: np.ndarray, process: np.ndarray) -> State:
    """A machine that has stood for long.

    Args:
        position_rad: Joint angles, (n,).
        process: Of the processes, (N_SHARED + n,), standard normal: their stationary distribution.
    """
    n = position_rad.size
    return State(
        arrived_period=np.full(n, -1, dtype=np.int64),
        arrived=np.zeros(n),
        held_s=np.zeros(n),
        rest_s=np.full(n, LONG_REST_S),
        stuck_s=np.zeros(n),
        sign=np.zeros(n),
        locked_s=np.zeros(n),
        valve=np.zeros(n),
        process=process,
        activity=np.zeros(1),
        travel_rad=np.zeros(n),
        drive_rad_s=np.zeros(n),
        lagged_rad_s=np.zeros(n),
        ringing_rad_s=np.zeros(n),
        ringing_rad_s2=np.zeros(n),
        drive_rad=position_rad.copy(),
        link_rad=position_rad.copy(),
    )
