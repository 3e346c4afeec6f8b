"""Contact of the chisel's tip with the ground and the machine's base, as a one-sided impulse.

The tip is a point without friction (assumed: the chisel slides). The impulse acts along the surface's normal and is
solved beside friction and end stops (`friction.py`); only a tip that touches feels it.
"""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import Contact
from pipeline.plant.scratch import N_CHAIN, Scratch
from pipeline.plant.state import State

STOP_RETURN = 0.2  # share of a stop's penetration that is pushed back per substep (Baumgarte)
CLEARANCE_M = 0.01  # assumed: a tip that is nearer is still in the same contact


@compiled
def find_contact(contact: Contact, state: State, scratch: Scratch) -> None:
    """Write the tip's gap to the nearest surface and its slopes into `scratch`, and count a contact that begins.

    Args:
        contact: The surfaces.
        state: Its count of contacts is changed.
        scratch: Work arrays after `dynamics` in the present configuration.
    """
    radius, height = scratch.centre[N_CHAIN, 0], contact.pivot_height_m + scratch.centre[N_CHAIN, 1]
    gap, normal_r, normal_z = height - contact.floor_m, 0.0, 1.0
    above, beside = height - contact.base_height_m, abs(radius) - contact.base_radius_m
    of_base = max(above, beside)  # inside both are negative, and the shallower way leads out
    if of_base < gap:
        gap = of_base
        if beside > above:
            normal_r, normal_z = (1.0 if radius >= 0.0 else -1.0), 0.0
    scratch.contact_gap[0] = gap
    scratch.contact_impulse[0] = 0.0
    if gap <= 0.0:
        for k in range(N_CHAIN):
            along_r = scratch.pivot[k, 1] - scratch.centre[N_CHAIN, 1]
            along_z = scratch.centre[N_CHAIN, 0] - scratch.pivot[k, 0]
            scratch.contact_arm[1 + k] = normal_r * along_r + normal_z * along_z
        if state.touches[0] == 0:
            state.touches[0] = 1
            state.contacts[0] += 1
    elif gap > CLEARANCE_M:
        state.touches[0] = 0


@compiled
def push_out(inverse_mass: np.ndarray, velocity: np.ndarray, scratch: Scratch, dt: float) -> None:
    """Let the surface take the tip's velocity into it, if the tip touches; changes `velocity` (n,), rad/s."""
    gap = scratch.contact_gap[0]
    if gap > 0.0:
        return
    arm, n = scratch.contact_arm, velocity.size
    opening, mobility = 0.0, 0.0  # speed away from the surface, m/s, and its change per impulse, 1/kg
    for i in range(n):
        opening += arm[i] * velocity[i]
        for j in range(n):
            mobility += arm[i] * inverse_mass[i, j] * arm[j]
    present = scratch.contact_impulse[0]
    wanted = max(present - (opening + STOP_RETURN * gap / dt) / mobility, 0.0)
    scratch.contact_impulse[0] = wanted
    for i in range(n):
        for j in range(n):
            velocity[i] += inverse_mass[i, j] * arm[j] * (wanted - present)
