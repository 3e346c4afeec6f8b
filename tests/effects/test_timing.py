"""Timing: seen from late readings, all commands act later by the same time."""

import numpy as np
import pytest

from pipeline.effects.timing import Timing

from .conftest import SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")


def test_all_joints_get_the_command_of_the_latency_ago():
    a = rows(1, 40)[1].command.astype(float)
    late = respond(Timing(SETTING), {"latency": np.array([0.15, 0.15])}, a)
    np.testing.assert_allclose(late[3:], a[:-3], atol=1e-12)
    assert not late[:3].any()


def test_half_a_step_is_the_mean_of_two_commands():
    a = np.array([[0.0, 0.0], [1.0, -1.0], [1.0, 1.0]])
    late = respond(Timing(SETTING), {"latency": np.array([0.025, 0.025])}, a)
    np.testing.assert_allclose(late, [[0.0, 0.0], [0.5, -0.5], [1.0, 0.0]], atol=1e-12)
