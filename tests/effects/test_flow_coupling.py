"""Flow coupling: hand numbers."""

import numpy as np
import pytest

from pipeline.effects.flow_coupling import FlowCoupling

from .conftest import SETTING, respond

pytestmark = pytest.mark.usefixtures("float64")

NONE_ALONE = {"loss_alone_positive": np.zeros(2), "loss_alone_negative": np.zeros(2)}
LOSS = {
    "loss_fraction": np.array([[0.7, 0.4], [0.2, 0.7]]),
    **NONE_ALONE,
}  # a joint's own entry does not count


def test_a_joint_loses_by_the_demand_of_the_other():
    u = np.array([[0.5, 0.1], [0.5, 0.0], [0.0, -0.1], [-0.25, 0.05]])  # of full speeds 0.5 and 0.1
    expected = [[0.5 * 0.6, 0.1 * 0.8], [0.5, 0.0], [0.0, -0.1], [-0.25 * 0.8, 0.05 * 0.9]]
    np.testing.assert_allclose(respond(FlowCoupling(SETTING), LOSS, u), expected, rtol=1e-12)


def test_a_joint_loses_by_itself_what_the_pump_lacks_for_it():
    alone = {"loss_alone_positive": np.array([0.3, 0.0]), "loss_alone_negative": np.array([0.1, 0.0])}
    u = np.array([[0.5, 0.0], [-0.5, 0.0], [0.2, 0.1]])
    expected = [[0.5 * 0.7, 0.0], [-0.5 * 0.9, 0.0], [0.2 * (0.7 - 0.4), 0.1 * (1 - 0.2 * 0.4)]]
    np.testing.assert_allclose(respond(FlowCoupling(SETTING), LOSS | alone, u), expected, rtol=1e-12)


def test_demand_and_loss_are_bounded():
    u = np.array([[0.1, 50.0]])
    np.testing.assert_allclose(
        respond(FlowCoupling(SETTING), LOSS, u)[0, 0], 0.1 * (1 - 0.4 * 1.5), rtol=1e-12
    )
    most = {"loss_fraction": np.full((2, 2), 0.9), **NONE_ALONE}
    np.testing.assert_allclose(respond(FlowCoupling(SETTING), most, u)[0, 0], 0.1 * 0.1, rtol=1e-12)


def test_joints_that_slow_each_other_down_are_inverted():
    effect, u = FlowCoupling(SETTING), np.array([[0.5, 0.1], [-0.3, 0.08], [0.45, -0.02]])
    v = respond(effect, LOSS, u)
    np.testing.assert_allclose(respond(effect, LOSS, v, step="invert"), u, rtol=2e-3)
