"""Work arrays of one substep, allocated once per run: allocation would cost more than the arithmetic."""

from typing import NamedTuple

import numpy as np

N_CHAIN = 3  # boom, arm, hammer
N_BODY = 4  # and the payload at the chisel's tip


class Scratch(NamedTuple):
    """Values within one substep; none persists. n joints."""

    mass: np.ndarray  # (n, n) mass matrix
    inverse_mass: np.ndarray  # (n, n)
    bias: np.ndarray  # (n,) gravity and velocity torques
    pivot: np.ndarray  # (3, 2) of the chain, (r, z)
    centre: np.ndarray  # (4, 2) of the bodies, (r, z)
    angle: np.ndarray  # (3,) of the links, absolute
    moment_arm: np.ndarray  # (n,)
    travel: np.ndarray  # (n,)
    piston_speed: np.ndarray  # (n,)
    drive: np.ndarray  # (n,) torque of chamber pressures
    drag: np.ndarray  # (n,) torque of viscous friction
    free: np.ndarray  # (n,) torque that accelerates
    old_velocity: np.ndarray  # (n,) at the substep's beginning
    friction_impulse: np.ndarray  # (n,)
    stop_impulse: np.ndarray  # (n,)
    friction_bound: np.ndarray  # (n,)
    contact_gap: np.ndarray  # (1,) between the tip and the nearest surface, m; not positive: it touches
    contact_arm: np.ndarray  # (n,) how fast the gap grows per joint velocity, m
    contact_impulse: np.ndarray  # (1,) from that surface, N s
    inlet: np.ndarray  # (n, 2, 2) flow from the supply into each chamber, and its slope
    outlet: np.ndarray  # (n, 2, 2) flow from each chamber to tank, and its slope
    cross: np.ndarray  # (n, 2) flow from the positive to the negative chamber, and its slope
    stiffness: np.ndarray  # (n, 2) volume over bulk modulus and substep
    solution: np.ndarray  # (n, 2, 2) pressure changes: constant, and per supply pressure change


def allocate(n: int) -> Scratch:
    """Work arrays for n joints."""
    return Scratch(
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros((N_CHAIN, 2)),
        np.zeros((N_BODY, 2)),
        np.zeros(N_CHAIN),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(1),
        np.zeros(n),
        np.zeros(1),
        np.zeros((n, 2, 2)),
        np.zeros((n, 2, 2)),
        np.zeros((n, 2)),
        np.zeros((n, 2)),
        np.zeros((n, 2, 2)),
    )
