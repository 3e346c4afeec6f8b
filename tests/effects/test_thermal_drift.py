"""Thermal drift: the loss of speed, and the lag, decay with the time since the start."""

import numpy as np
import pytest

from pipeline.effects.effect import Signals
from pipeline.effects.thermal_drift import ThermalDrift

from .conftest import DT_S, SETTING, respond, signals_at

pytestmark = pytest.mark.usefixtures("float64")

VALUES = {
    "cold_speed_loss": np.array([0.3, 0.2]),
    "warm_gain": np.array([0.1, 0.0]),
    "cold_lag": np.array([0.0, 0.0]),
    "fall_share": np.array([1.0, 1.0]),
    "lag_time_ratio": np.array([1.0, 1.0]),
    "time_constant": np.array([100.0, 100.0]),
}


@pytest.mark.parametrize("time_s", [0.0, 100.0, 250.0, 5000.0])
def test_speed_rises_as_the_oil_warms(time_s):
    effect = ThermalDrift(SETTING)
    _, v = effect.apply(VALUES, effect.initial(()), np.array([1.0, -1.0]), signals_at(time_s=time_s))
    left = np.exp(-time_s / 100.0)
    np.testing.assert_allclose(v, [1.1 - 0.3 * left, -(1.0 - 0.2 * left)], rtol=1e-12)


def test_cold_oil_responds_late_by_its_lag_and_warm_oil_does_not():
    """The area between a step and the response to it is the lag."""
    n_rows = 400
    values = VALUES | {
        "cold_speed_loss": np.zeros(2),
        "warm_gain": np.zeros(2),
        "cold_lag": np.array([0.1, 0.04]),
    }
    u, nothing = np.ones((n_rows, 2)), np.zeros((n_rows, 2))
    for time_s, left in ((0.0, 1.0), (1000.0, 0.0)):
        signals = Signals(nothing, nothing, np.full(n_rows, time_s))
        v = respond(ThermalDrift(SETTING), values, u, signals)
        np.testing.assert_allclose(
            DT_S * np.sum(u - v, axis=0), left * values["cold_lag"], rtol=1e-9, atol=1e-5
        )


def test_cold_oil_is_less_late_at_stops_by_their_share():
    """The area between a step and the response to it: the lag while starting, a share of it while stopping."""
    n_rows = 200
    values = VALUES | {
        "cold_speed_loss": np.zeros(2),
        "warm_gain": np.zeros(2),
        "cold_lag": np.array([0.3, 0.3]),
        "fall_share": np.array([0.2, 1.0]),
    }
    u = np.concatenate([np.ones((n_rows, 2)), np.zeros((n_rows, 2))])
    signals = Signals(np.zeros_like(u), np.zeros_like(u), np.zeros(2 * n_rows))
    late = DT_S * np.cumsum(u - respond(ThermalDrift(SETTING), values, u, signals), axis=0)
    np.testing.assert_allclose(late[n_rows - 1], 0.3, rtol=1e-4)
    np.testing.assert_allclose(late[n_rows - 1] - late[-1], 0.3 * values["fall_share"], rtol=1e-4)


def test_the_lag_may_last_longer_than_the_loss_of_speed():
    n_rows, time_s, ratio = 400, 150.0, 3.0
    values = VALUES | {
        "cold_speed_loss": np.zeros(2),
        "warm_gain": np.zeros(2),
        "cold_lag": np.array([0.3, 0.3]),
        "lag_time_ratio": np.array([1.0, ratio]),
    }
    u, nothing = np.ones((n_rows, 2)), np.zeros((n_rows, 2))
    v = respond(ThermalDrift(SETTING), values, u, Signals(nothing, nothing, np.full(n_rows, time_s)))
    left = np.exp(-time_s / (100.0 * np.array([1.0, ratio])))
    np.testing.assert_allclose(DT_S * np.sum(u - v, axis=0), 0.3 * left, rtol=1e-4)


def test_cold_oil_does_not_begin_at_once():
    """Two equal lags in series respond to a step with 1 − (1 + t/τ) e^{−t/τ} in continuous time, τ half of the lag."""
    n_rows, lag_s = 60, 1.0
    values = VALUES | {
        "cold_speed_loss": np.zeros(2),
        "warm_gain": np.zeros(2),
        "cold_lag": np.full(2, lag_s),
    }
    u, nothing = np.ones((n_rows, 2)), np.zeros((n_rows, 2))
    v = respond(ThermalDrift(SETTING), values, u, Signals(nothing, nothing, np.zeros(n_rows)))
    time = DT_S * (0.5 + np.arange(n_rows)) / (0.5 * lag_s)
    np.testing.assert_allclose(v[:, 0], 1.0 - (1.0 + time) * np.exp(-time), atol=0.03)
