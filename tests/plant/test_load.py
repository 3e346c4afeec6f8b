"""The closed-form rigid-body load against numerical derivatives of the energies, and against the URDF."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.plant.physics.load import dynamics, gravity_torque, inverse_mass, potential_energy
from pipeline.plant.scratch import allocate


def kinetic_energy(links, q, v):
    """Independent: positions by complex numbers in the turning plane, velocities by finite differences."""

    def bodies(q):
        angle = np.cumsum(q[1:])
        pivot = complex(links.pivot_radius_m, 0.0)
        centres = []
        for i in range(3):
            turn = np.exp(1j * angle[i])
            centres.append(pivot + complex(*links.centre_m[i]) * turn)
            pivot = pivot + links.length_m[i] * turn
        return np.array([*centres, pivot])

    step = 1e-6
    planar = (bodies(q + step * v) - bodies(q - step * v)) / (2 * step)
    mass = np.array([*links.mass_kg, links.payload_kg])
    omega = np.cumsum(v[1:])
    angle = np.cumsum(q[1:])
    energy = 0.5 * np.sum(mass * np.abs(planar) ** 2) + 0.5 * np.sum(links.inertia_kg_m2 * omega**2)
    swing = links.turret_inertia_kg_m2 + np.sum(mass * bodies(q).real ** 2)
    swing += np.sum(links.inertia_kg_m2 * np.cos(angle) ** 2)
    return energy + 0.5 * swing * v[0] ** 2


@pytest.fixture(params=range(5))
def state(request, nominal):
    random = np.random.default_rng(request.param)
    q = random.uniform(nominal.linkage.lower_rad, nominal.linkage.upper_rad)
    return q, random.uniform(-1.0, 1.0, 4), nominal.links._replace(payload_kg=30.0)


def test_gravity_is_the_gradient_of_potential_energy(state):
    q, _, links = state
    torque = np.empty(4)
    gravity_torque(links, q, torque)
    step = 1e-6
    gradient = [
        (potential_energy(links, q + step * e) - potential_energy(links, q - step * e)) / (2 * step)
        for e in np.eye(4)
    ]
    np.testing.assert_allclose(torque, gradient, atol=1e-4)


def test_mass_matrix_gives_the_kinetic_energy(state):
    q, v, links = state
    scratch = allocate(4)
    dynamics(links, q, v, scratch)
    np.testing.assert_allclose(0.5 * v @ scratch.mass @ v, kinetic_energy(links, q, v), rtol=1e-6)
    inverse_mass(scratch.mass, scratch.inverse_mass)
    np.testing.assert_allclose(scratch.mass @ scratch.inverse_mass, np.eye(4), atol=1e-9)


def test_bias_satisfies_lagrange(state):
    """d/dt(dT/dv) - dT/dq + dV/dq = 0 at zero acceleration and zero torque defines the bias."""
    q, v, links = state
    scratch = allocate(4)
    dynamics(links, q, v, scratch)
    bias = scratch.bias.copy()
    step = 1e-5

    def momentum(q):
        dynamics(links, q, v, scratch)
        return scratch.mass @ v

    rate = (momentum(q + step * v) - momentum(q - step * v)) / (2 * step)
    gradient = np.array(
        [
            (kinetic_energy(links, q + step * e, v) - kinetic_energy(links, q - step * e, v)) / (2 * step)
            for e in np.eye(4)
        ]
    )
    gravity = np.empty(4)
    gravity_torque(links, q, gravity)
    np.testing.assert_allclose(bias, rate - gradient + gravity, atol=2e-3)


def test_masses_are_those_of_the_urdf(nominal):
    root = ElementTree.parse(MACHINE_DIRECTORY / "bobcat_e10.urdf").getroot()
    for i, name in enumerate(("boom", "arm", "hammer")):
        inertial = root.find(f"./link[@name='{name}']/inertial")
        assert float(inertial.find("mass").get("value")) == nominal.links.mass_kg[i]
        x, _, z = (float(value) for value in inertial.find("origin").get("xyz").split())
        np.testing.assert_allclose([x, z], nominal.links.centre_m[i])
        assert float(inertial.find("inertia").get("iyy")) == pytest.approx(
            nominal.links.inertia_kg_m2[i], abs=0.01
        )
