"""Every quantity of an arm's drives, in SI units, and what they remember.

Shapes: (n,) one value per joint, (n, 2) one per joint and direction of motion, `NEGATIVE` and `POSITIVE`. Lengths,
forces and speeds of a revolute joint's cylinder are those of its rod. Quantities that only effects change are neutral
in a sound arm.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.closed_loop.kinematic.machine import Encoder

NEGATIVE, POSITIVE = 0, 1
SUPPLY, N_SHARED = 0, 1
"""The process that all joints share, in front of those of single joints in `State.process`."""


class Valve(NamedTuple):
    """From the command to the spool."""

    dead_time_s: np.ndarray  # (n,)
    dead_time_jitter_s: float  # half width of the even spread of each command's dead time
    overlap: np.ndarray  # (n,) share of the command that does not open the valve
    time_constant_s: np.ndarray  # (n,) of the spool
    conductance: np.ndarray  # (n, 2) m³ / (s √Pa) of each port, fully open, in each direction
    noise_std: float  # of the logarithm of each joint's conductance
    noise_correlation_s: float
    rest_threshold_s: np.ndarray  # (n,) silt: starts after longer rests stick
    mean_extra_time_s: np.ndarray  # (n,) and for how long in the mean they do


class Supply(NamedTuple):
    """Pump, oil, and what all joints share."""

    pressure_Pa: float  # at which the pump delivers nothing
    flow_m3_s: float  # that the pump delivers at most
    gain_m3_s_Pa: float  # of the pump's controller
    volume_m3: float
    modulus_Pa: np.ndarray  # (n,) of oil and hoses of each cylinder
    wander_std: float  # of the logarithm of the set pressure
    wander_correlation_s: float
    cold_K: float  # by which the oil is colder at the session's start than later
    warm_up_s: float


class Cylinder(NamedTuple):
    """From flow to force."""

    area_m2: np.ndarray  # (n,)
    dead_volume_m3: np.ndarray  # (n,) of each chamber with the piston at its end
    half_stroke_m: np.ndarray  # (n,)
    viscous_N_s_m: np.ndarray  # (n,)
    leakage_m3_s_Pa: np.ndarray  # (n,) past the piston
    play_m: np.ndarray  # (n,) of the pin between rod and link
    cushion_m: np.ndarray  # (n, 2) before which end the outlet is throttled, from how far on
    cushion_share: np.ndarray  # (n, 2) of the outlet's area that is left there


class Odd(NamedTuple):
    """What no family of the contract describes; all losses are shares of a port's area."""

    pull: np.ndarray  # (n, n) at [j, i]: loss of joint j while joint i is commanded beyond half
    hold_boost: np.ndarray  # (n,) gain of area once a command's direction has been held for `hold_s`
    hold_s: float
    lockout_s: np.ndarray  # (n,) for how long the spool stays shut after the command's sign is reversed
    heat_loss: np.ndarray  # (n,) of a coil that was driven at full current for long
    heat_s: float
    kink_loss: np.ndarray  # (n, n) at [j, i]: loss of joint j while joint i is beyond a place
    kink_at: np.ndarray  # (n,) rad or m of joint i
    block_loss: np.ndarray  # (n,) during random episodes
    block_share: float  # of the time
    block_s: float  # mean length of an episode
    timer_loss: np.ndarray  # (n,) in the first half of each period of the wall clock
    timer_s: float


class Quantities(NamedTuple):
    """All of one arm's drives."""

    valve: Valve
    supply: Supply
    cylinder: Cylinder
    encoder: Encoder
    odd: Odd


class State(NamedTuple):
    """All that the drives remember."""

    arrived_period: np.ndarray  # (n,) int64, of the command that the driver has; -1: none yet
    command: np.ndarray  # (n,) that command
    spool: np.ndarray  # (n,)
    sign: np.ndarray  # (n,) last direction that was commanded
    held_s: np.ndarray  # (n,) since when the command has its direction
    rest_s: np.ndarray  # (n,) since when it is zero
    stuck_s: np.ndarray  # (n,) for how much longer the spool sticks
    locked_s: np.ndarray  # (n,) for how much longer it is locked out
    heat: np.ndarray  # (n,) 0 to 1
    blocked: np.ndarray  # (n,) 0 or 1
    pressure_Pa: np.ndarray  # (n, 2) of the chambers that push in each direction
    gap_m: np.ndarray  # (n,) rod before link, at most half the play
    supply_Pa: np.ndarray  # (1,)
    process: np.ndarray  # (N_SHARED + n,) Ornstein-Uhlenbeck processes of unit variance


def resting_state(quantities: Quantities, process: np.ndarray) -> State:
    """An arm that has stood for long, with its pump running.

    Args:
        quantities: Of the arm.
        process: (N_SHARED + n,) standard normal.
    """
    n = quantities.cylinder.area_m2.size
    half = np.full((n, 2), 0.5 * quantities.supply.pressure_Pa)
    return State(
        arrived_period=np.full(n, -1, dtype=np.int64),
        pressure_Pa=half,
        supply_Pa=np.array([quantities.supply.pressure_Pa]),
        process=process,
        **{name: np.zeros(n) for name in ("command", "spool", "sign", "held_s", "stuck_s", "locked_s")},
        **{name: np.zeros(n) for name in ("heat", "blocked", "gap_m")},
        rest_s=np.full(n, 60.0),
    )
