"""Lag: a first-order response; lead: u + |τ| du/dt."""

import numpy as np
import pytest

from pipeline.effects.lag import Lag

from .conftest import DT_S, SETTING, respond

pytestmark = pytest.mark.usefixtures("float64")


def with_time_constant(tau: np.ndarray) -> dict:
    return Lag(SETTING).neutral() | {"added_time_constant": tau}


def test_step_response_is_an_exponential():
    tau = np.array([0.2, 0.07])
    v = respond(Lag(SETTING), with_time_constant(tau), np.ones((30, 2)))
    t_s = DT_S * np.arange(1, 31)[:, None]  # u acts from the step's start, v is that at its end
    np.testing.assert_allclose(v, 1.0 - np.exp(-t_s / tau), rtol=1e-12)


def test_the_way_lost_after_a_start_is_speed_times_time_constant():
    v = respond(Lag(SETTING), with_time_constant(np.array([0.4, 0.4])), np.ones((400, 2)))
    lost = DT_S * np.sum(1.0 - v, axis=0)
    # Σ e^{-m Δt/τ} Δt, which is τ but for the step's finite length
    np.testing.assert_allclose(lost, DT_S / np.expm1(DT_S / 0.4), rtol=1e-9)


def test_a_lead_adds_the_slope():
    u = np.sin(np.arange(20.0))[:, None] * [1.0, 0.1]
    v = respond(Lag(SETTING), with_time_constant(np.array([-0.1, -0.025])), u)
    slope = np.diff(u, axis=0, prepend=0.0) / DT_S
    np.testing.assert_allclose(v, u + np.array([0.1, 0.025]) * slope, atol=1e-12)


def test_time_constants_far_below_the_step_change_nothing():
    u = np.sin(np.arange(20.0))[:, None] * [1.0, 0.1]
    v = respond(Lag(SETTING), with_time_constant(np.array([1e-4, -1e-9])), u)
    np.testing.assert_allclose(v, u, atol=1e-6)
