"""Velocity estimates from positions alone: the loop tracker (paper, section on the dynamic models).

A proportional-integral loop makes an estimate q̂ follow the measured position q. Its integral term is the
velocity estimate; the rate of q̂ would pass high frequencies. Per joint, from q̂ = q₀ and i = 0 (contract,
section 2):

    e = q − q̂;  i += k_i·e·Δt;  q̂ += Δt·(k_p·e + i);  q̇ = i
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError


@dataclass
class LoopTrackerConfig:
    """Section `control.loop_tracker` of a profile.

    Attributes:
        proportional_gain: k_p, 1/s.
        integral_gain: k_i, 1/s².
    """

    proportional_gain: float
    integral_gain: float

    def __post_init__(self) -> None:
        if not self.proportional_gain > 0:
            raise InputError(
                f"loop_tracker.proportional_gain is {self.proportional_gain}; it must be positive"
            )
        if not self.integral_gain > 0:
            raise InputError(f"loop_tracker.integral_gain is {self.integral_gain}; it must be positive")


class LoopTrackerState(NamedTuple):
    """The tracker's state, per joint.

    Attributes:
        q_estimate: q̂, shape (n_joint,), float64, rad or m.
        integral: i, the velocity estimate, shape (n_joint,), float64, rad/s or m/s.
    """

    q_estimate: np.ndarray
    integral: np.ndarray


def initial_state(q: np.ndarray) -> LoopTrackerState:
    """Return the state before the first sample `q`, shape (n_joint,): q̂ = q, i = 0."""
    q = np.asarray(q, dtype=np.float64)
    return LoopTrackerState(q.copy(), np.zeros_like(q))


def advance(
    state: LoopTrackerState, q: np.ndarray, dt_s: float, config: LoopTrackerConfig
) -> tuple[LoopTrackerState, np.ndarray]:
    """Process one sample, as a controller does online.

    Args:
        state: State after the previous sample.
        q: Measured positions, shape (n_joint,), rad or m.
        dt_s: Time step.
        config: Gains.

    Returns:
        The new state and the velocity estimate, shape (n_joint,), float64, rad/s or m/s.
    """
    error = np.asarray(q, dtype=np.float64) - state.q_estimate
    integral = state.integral + config.integral_gain * error * dt_s
    q_estimate = state.q_estimate + dt_s * (config.proportional_gain * error + integral)
    return LoopTrackerState(q_estimate, integral), integral
