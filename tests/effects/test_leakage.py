"""Leakage: creep while the command is zero, and a share of it in motion."""

import numpy as np
import pytest

from pipeline.effects.leakage import Leakage

from .conftest import SETTING, signals_at

pytestmark = pytest.mark.usefixtures("float64")

U = np.array([0.3, 0.05])


def test_joints_creep_while_they_are_not_commanded():
    effect = Leakage(SETTING)
    values = effect.neutral() | {"sag_rate": np.array([-0.02, 0.01])}
    for command, creep in [((0, 0), (-0.02, 0.01)), ((1, 0), (0.0, 0.01)), ((0, -0.3), (-0.02, 0.0))]:
        _, v = effect.apply(values, (), U, signals_at(command=np.array(command, float)))
        np.testing.assert_allclose(v, U + creep, rtol=1e-12)


def test_a_share_of_the_creep_is_there_in_motion_by_its_direction():
    effect = Leakage(SETTING)
    values = effect.neutral() | {
        "sag_rate": np.array([-0.02, 0.01]),
        "share_in_positive_motion": np.array([1.5, 0.0]),
        "share_in_negative_motion": np.array([0.5, 2.0]),
    }
    for command, creep in [((1, 1), (-0.03, 0.0)), ((-1, -1), (-0.01, 0.02)), ((0, 0), (-0.02, 0.01))]:
        _, v = effect.apply(values, (), U, signals_at(command=np.array(command, float)))
        np.testing.assert_allclose(v, U + creep, rtol=1e-12)
