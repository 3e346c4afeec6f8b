"""Lag: a first-order response; lead: u + |τ| du/dt."""

import numpy as np
import pytest

from pipeline.effects.lag import Lag

from .conftest import DT_S, SETTING, respond

pytestmark = pytest.mark.usefixtures("float64")


def with_time_constant(tau: np.ndarray) -> dict:
    return Lag(SETTING).neutral() | {"added_time_constant": tau}


def test_step_response_is_that_of_a_backward_difference():
    tau = np.array([0.2, 0.07])
    v = respond(Lag(SETTING), with_time_constant(tau), np.ones((30, 2)))
    steps = np.arange(1, 31)[:, None]
    np.testing.assert_allclose(v, 1.0 - (1.0 + DT_S / tau) ** -steps, rtol=1e-12)


def test_the_way_lost_after_a_start_is_speed_times_time_constant():
    v = respond(Lag(SETTING), with_time_constant(np.array([0.4, 0.02])), np.ones((400, 2)))
    np.testing.assert_allclose(DT_S * np.sum(1.0 - v, axis=0), [0.4, 0.02], rtol=1e-9)


def test_a_continuous_lag_is_read_as_long_as_it_is():
    """A lag of the continuous velocity, which a log shows by positions at the ends of the steps."""
    tau, fine = 0.15, 1000
    u = np.repeat(np.sign(np.sin(0.31 * np.arange(400))), fine)
    speed = np.zeros(u.size + 1)
    decay = np.exp(-DT_S / fine / tau)
    for i, target in enumerate(u):
        speed[i + 1] = target + decay * (speed[i] - target)
    positions = np.cumsum(0.5 * (speed[1:] + speed[:-1]))[fine - 1 :: fine] * DT_S / fine
    measured = np.diff(positions, prepend=0.0) / DT_S
    commanded = u[::fine, None] * [1.0, 1.0]
    taus = np.linspace(0.1, 0.2, 101)
    # One candidate to a place in the batch: all are tried at once.
    candidates = with_time_constant(np.repeat(taus[:, None], 2, axis=1))
    responses = respond(Lag(SETTING), candidates, np.repeat(commanded[:, None], len(taus), axis=1))
    misfit = np.sum((responses[..., 0] - measured[:, None]) ** 2, axis=0)
    assert taus[int(np.argmin(misfit))] == pytest.approx(tau, abs=0.005)


def test_a_lead_adds_the_slope():
    u = np.sin(np.arange(20.0))[:, None] * [1.0, 0.1]
    v = respond(Lag(SETTING), with_time_constant(np.array([-0.1, -0.025])), u)
    slope = np.diff(u, axis=0, prepend=0.0) / DT_S
    np.testing.assert_allclose(v, u + np.array([0.1, 0.025]) * slope, atol=1e-12)


def test_small_time_constants_move_the_response_by_their_length_to_either_side():
    u = np.sin(np.arange(20.0))[:, None] * [1.0, 0.1]
    v = respond(Lag(SETTING), with_time_constant(np.array([1e-6, -1e-6])), u)
    slope = np.diff(u, axis=0, prepend=0.0) / DT_S
    np.testing.assert_allclose(v - u, slope * [-1e-6, 1e-6], atol=1e-9)
