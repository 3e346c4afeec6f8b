"""Friction of seals and pins, and mechanical end stops, as bounded impulses.

Stribeck curve with Coulomb and static part (Armstrong-Hélouvry, Dupont & Canudas de Wit 1994, section 2):

    F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²)   (the viscous part is added to the forces directly).

Friction and stops are solved on the velocity level: the impulse that would stop the joint, bounded by F·dt
(friction) or one-sided (stop), in a few Gauss-Seidel sweeps over the joints (time stepping of Moreau). A
resting joint therefore really rests, and a stop is never entered by more than velocity times one substep.
"""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import Friction, Linkage
from pipeline.plant.physics.contact import STOP_RETURN, push_out
from pipeline.plant.scratch import Scratch
from pipeline.plant.state import State

N_SWEEP = 3


@compiled
def stribeck_force(friction: Friction, joint: int, piston_speed: float) -> float:
    """Bound of the seal friction force of one cylinder, N."""
    excess = friction.static_ratio[joint] - 1.0
    ratio = piston_speed / friction.stribeck_speed_m_s
    return friction.coulomb_N[joint] * (1.0 + excess * np.exp(-ratio * ratio))


@compiled
def _push(inverse_mass: np.ndarray, velocity: np.ndarray, joint: int, impulse: float) -> None:
    """Apply an impulse at one joint to all velocities."""
    for i in range(velocity.size):
        velocity[i] += inverse_mass[i, joint] * impulse


@compiled
def _stop(linkage: Linkage, state: State, scratch: Scratch, joint: int, dt: float) -> None:
    """Let the mechanical stop of one joint take its velocity, if the joint is at it."""
    angle = state.angle_rad[joint]
    if linkage.lower_rad[joint] < angle < linkage.upper_rad[joint]:
        return
    beyond = max(angle - linkage.upper_rad[joint], 0.0) + min(angle - linkage.lower_rad[joint], 0.0)
    present = scratch.stop_impulse[joint]
    excess = state.velocity_rad_s[joint] + STOP_RETURN * beyond / dt
    wanted = present - excess / scratch.inverse_mass[joint, joint]
    wanted = max(wanted, 0.0) if angle <= linkage.lower_rad[joint] else min(wanted, 0.0)
    scratch.stop_impulse[joint] = wanted
    _push(scratch.inverse_mass, state.velocity_rad_s, joint, wanted - present)


@compiled
def apply_impulses(friction: Friction, linkage: Linkage, state: State, scratch: Scratch, dt: float) -> None:
    """Change the velocities by the impulses of friction, stops and contact, which stay in `scratch`."""
    velocity = state.velocity_rad_s
    n = velocity.size
    for j in range(n):
        arm = scratch.moment_arm[j]
        force = stribeck_force(friction, j, arm * velocity[j])
        scratch.friction_bound[j] = (force * arm + friction.pin_Nm[j]) * dt
        scratch.friction_impulse[j] = 0.0
        scratch.stop_impulse[j] = 0.0
    for _ in range(N_SWEEP):
        for j in range(n):
            present, bound = scratch.friction_impulse[j], scratch.friction_bound[j]
            wanted = min(max(present - velocity[j] / scratch.inverse_mass[j, j], -bound), bound)
            scratch.friction_impulse[j] = wanted
            _push(scratch.inverse_mass, velocity, j, wanted - present)
        for j in range(n):
            _stop(linkage, state, scratch, j, dt)
        push_out(scratch.inverse_mass, velocity, scratch, dt)
