"""Oscillation: step response of a second-order resonance."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from pipeline.effects.oscillation import Oscillation

from .conftest import DT_S, SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")

FREQUENCY, DAMPING = np.array([0.5, 1.0]), np.array([0.1, 0.3])
VALUES = {"share": np.ones(2), "frequency": FREQUENCY, "damping_ratio": DAMPING}


def test_overshoot_and_period_of_a_step():
    damped = FREQUENCY * np.sqrt(1 - DAMPING**2)  # Hz
    # One of the samples lies within half a step of each peak, where the response is flat.
    v = respond(Oscillation(SETTING), VALUES, np.ones((200, 2)))
    overshoot = np.exp(-np.pi * DAMPING / np.sqrt(1 - DAMPING**2))
    np.testing.assert_allclose(v.max(axis=0) - 1, overshoot, rtol=0.02)
    peak_s = DT_S * (1 + v.argmax(axis=0))
    np.testing.assert_allclose(peak_s, 0.5 / damped, atol=0.6 * DT_S)
    np.testing.assert_allclose(v[-1], 1.0, atol=0.06)


def test_discretisation_is_exact_for_held_inputs():
    u = rows(4, 80)[0].astype(float)
    v = respond(Oscillation(SETTING), VALUES, u)
    for j in range(2):
        omega, zeta = 2 * np.pi * FREQUENCY[j], DAMPING[j]
        system = (np.array([[0, 1], [-(omega**2), -2 * zeta * omega]]), np.array([[0], [omega**2]]))
        a, b, *_ = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), DT_S, "zoh")
        x, expected = np.zeros(2), []
        for value in u[:, j]:
            x = a @ x + b[:, 0] * value
            expected.append(x[0])
        np.testing.assert_allclose(v[:, j], expected, atol=1e-12)


def test_a_share_mixes_drive_and_mode():
    u = rows(5, 40)[0].astype(float)
    full = respond(Oscillation(SETTING), VALUES, u)
    part = respond(Oscillation(SETTING), {**VALUES, "share": np.array([0.25, 0.0])}, u)
    np.testing.assert_allclose(part, u + [0.25, 0.0] * (full - u), atol=1e-12)


def test_what_drives_the_mode_is_recovered_from_noisy_velocities_without_its_ringing():
    """Far nearer to it than the velocities are, and than the filter's exact inverse, which amplifies their noise."""
    values = {"share": np.ones(2), "frequency": np.array([1.2, 2.0]), "damping_ratio": np.array([0.05, 0.1])}
    hold = np.repeat(np.random.default_rng(8).integers(-1, 2, (20, 2)), 30, axis=0)
    u = SETTING.speed_scale * hold
    v = respond(Oscillation(SETTING), values, u)
    v = v + 0.01 * SETTING.speed_scale * np.random.default_rng(9).standard_normal(v.shape)
    drive = respond(Oscillation(SETTING), values, v, None, "invert")
    ringing, left = (np.sqrt(np.mean((of - u) ** 2, axis=0)) for of in (v, drive))
    assert np.all(left < 0.5 * ringing)
