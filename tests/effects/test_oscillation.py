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
