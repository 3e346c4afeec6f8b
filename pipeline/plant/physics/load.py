"""Rigid-body load: swing column and the planar chain boom, arm, hammer (and payload) in closed form.

Lagrange's equations in the joint angles. Every body is a point mass at its centre plus an inertia about it;
with J_k = ∂p/∂q_k of a centre p = (r, z), perpendicular to the line from pivot k to the centre,

    M_kl = Σ_b m_b J_k·J_l + Σ_{b ≥ k,l} I_b,          gravity_k = Σ_b m_b g J_k,z,
    I_swing = I_turret + Σ_b (m_b r_b² + I_b cos² θ_b),

and the velocity terms are centripetal in the plane and centrifugal about the swing axis. Joint order: swing,
boom, arm, bucket.
"""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import Links
from pipeline.plant.scratch import N_BODY, N_CHAIN, Scratch


@compiled
def _centres(links: Links, q: np.ndarray, pivot: np.ndarray, centre: np.ndarray, angle: np.ndarray) -> None:
    """Pivots (3, 2), body centres (4, 2) as (r, z), and absolute link angles (3,), from joint angles."""
    r = links.pivot_radius_m
    z = 0.0
    theta = 0.0
    for i in range(N_CHAIN):
        theta += q[1 + i]
        c, s = np.cos(theta), np.sin(theta)
        angle[i] = theta
        pivot[i, 0], pivot[i, 1] = r, z
        centre[i, 0] = r + links.centre_m[i, 0] * c - links.centre_m[i, 1] * s
        centre[i, 1] = z + links.centre_m[i, 0] * s + links.centre_m[i, 1] * c
        r += links.length_m[i] * c
        z += links.length_m[i] * s
    centre[N_CHAIN, 0], centre[N_CHAIN, 1] = r, z


@compiled
def _body_mass(links: Links, body: int) -> float:
    return links.payload_kg if body == N_CHAIN else links.mass_kg[body]


@compiled
def gravity_torque(links: Links, q: np.ndarray, torque: np.ndarray) -> None:
    """Torque that holds the arm still against gravity, written into `torque` (4,), N m."""
    pivot, centre, angle = np.empty((N_CHAIN, 2)), np.empty((N_BODY, 2)), np.empty(N_CHAIN)
    _centres(links, q, pivot, centre, angle)
    torque[:] = 0.0
    for b in range(N_BODY):
        for k in range(min(b, N_CHAIN - 1) + 1):
            torque[1 + k] += _body_mass(links, b) * links.gravity_m_s2 * (centre[b, 0] - pivot[k, 0])


@compiled
def potential_energy(links: Links, q: np.ndarray) -> float:
    """Of gravity, relative to the height of the boom pivot, J."""
    pivot, centre, angle = np.empty((N_CHAIN, 2)), np.empty((N_BODY, 2)), np.empty(N_CHAIN)
    _centres(links, q, pivot, centre, angle)
    energy = 0.0
    for b in range(N_BODY):
        energy += _body_mass(links, b) * links.gravity_m_s2 * centre[b, 1]
    return energy


@compiled
def dynamics(links: Links, q: np.ndarray, v: np.ndarray, scratch: Scratch) -> None:
    """Mass matrix and bias torque (gravity, Coriolis, centrifugal): mass @ acceleration + bias = torque.

    The swing joint is decoupled in the mass matrix. Writes `scratch.mass`, kg m², and `scratch.bias`, N m.

    Args:
        links: the bodies.
        q: joint angles (4,), rad.
        v: joint velocities (4,), rad/s.
        scratch: work arrays.
    """
    pivot, centre, angle, mass, bias = (
        scratch.pivot,
        scratch.centre,
        scratch.angle,
        scratch.mass,
        scratch.bias,
    )
    _centres(links, q, pivot, centre, angle)
    mass[:] = 0.0
    bias[:] = 0.0
    swing_squared = v[0] * v[0]
    inertia = links.turret_inertia_kg_m2
    inertia_rate = 0.0
    for b in range(N_BODY):
        m = _body_mass(links, b)
        last = min(b, N_CHAIN - 1)
        own = links.inertia_kg_m2[b] if b < N_CHAIN else 0.0
        # centripetal acceleration of the centre from the links' turning
        ar, az, omega = 0.0, 0.0, 0.0
        for i in range(last + 1):
            omega += v[1 + i]
            if i < last:
                dr, dz = pivot[i + 1, 0] - pivot[i, 0], pivot[i + 1, 1] - pivot[i, 1]
            else:
                dr, dz = centre[b, 0] - pivot[i, 0], centre[b, 1] - pivot[i, 1]
            ar -= omega * omega * dr
            az -= omega * omega * dz
        cosine, sine = np.cos(angle[last]), np.sin(angle[last])
        inertia += m * centre[b, 0] ** 2 + own * cosine * cosine
        for k in range(last + 1):
            jr, jz = -(centre[b, 1] - pivot[k, 1]), centre[b, 0] - pivot[k, 0]
            half_slope = m * centre[b, 0] * jr - own * sine * cosine  # half of d(swing inertia)/dq_k
            bias[1 + k] += m * (jr * ar + jz * (az + links.gravity_m_s2)) - swing_squared * half_slope
            inertia_rate += 2.0 * half_slope * v[1 + k]
            for j in range(k + 1):
                ir, iz = -(centre[b, 1] - pivot[j, 1]), centre[b, 0] - pivot[j, 0]
                entry = m * (jr * ir + jz * iz) + own
                mass[1 + k, 1 + j] += entry
                if j != k:
                    mass[1 + j, 1 + k] += entry
    mass[0, 0] = inertia
    bias[0] = inertia_rate * v[0]


@compiled
def inverse_mass(mass: np.ndarray, inverse: np.ndarray) -> None:
    """Inverse of the block-diagonal mass matrix (swing; symmetric 3x3 chain), into `inverse` (4, 4)."""
    a, b, c = mass[1, 1], mass[1, 2], mass[1, 3]
    d, e, f = mass[2, 2], mass[2, 3], mass[3, 3]
    c11, c12, c13 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c11 + b * c12 + c * c13
    inverse[:] = 0.0
    inverse[0, 0] = 1.0 / mass[0, 0]
    inverse[1, 1] = c11 / determinant
    inverse[1, 2] = inverse[2, 1] = c12 / determinant
    inverse[1, 3] = inverse[3, 1] = c13 / determinant
    inverse[2, 2] = (a * f - c * c) / determinant
    inverse[2, 3] = inverse[3, 2] = (b * c - a * e) / determinant
    inverse[3, 3] = (a * d - b * b) / determinant
