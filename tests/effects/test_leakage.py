"""Leakage: creep while the command is zero, and only then."""

import numpy as np
import pytest

from pipeline.effects.leakage import Leakage

from .conftest import SETTING, signals_at

pytestmark = pytest.mark.usefixtures("float64")


def test_joints_creep_while_they_are_not_commanded():
    effect, values = Leakage(SETTING), {"sag_rate": np.array([-0.02, 0.01])}
    u = np.array([0.3, 0.05])
    for command, creep in [((0, 0), (-0.02, 0.01)), ((1, 0), (0.0, 0.01)), ((0, -0.3), (-0.02, 0.0))]:
        _, v = effect.apply(values, (), u, signals_at(command=np.array(command, float)))
        np.testing.assert_allclose(v, u + creep, rtol=1e-12)
