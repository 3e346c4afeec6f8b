"""Thermal drift: the loss of speed decays with the time since the start."""

import numpy as np
import pytest

from pipeline.effects.thermal_drift import ThermalDrift

from .conftest import SETTING, signals_at

pytestmark = pytest.mark.usefixtures("float64")

VALUES = {
    "cold_speed_loss": np.array([0.3, 0.2]),
    "warm_gain": np.array([0.1, 0.0]),
    "time_constant": np.array([100.0, 100.0]),
}


@pytest.mark.parametrize("time_s", [0.0, 100.0, 250.0, 5000.0])
def test_speed_rises_as_the_oil_warms(time_s):
    _, v = ThermalDrift(SETTING).apply(VALUES, (), np.array([1.0, -1.0]), signals_at(time_s=time_s))
    left = np.exp(-time_s / 100.0)
    np.testing.assert_allclose(v, [1.1 - 0.3 * left, -(1.0 - 0.2 * left)], rtol=1e-12)
