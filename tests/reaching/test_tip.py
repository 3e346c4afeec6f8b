"""The tip component by component: against `Arm.forward`, and against MuJoCo on a robot with everything in it."""

from pathlib import Path

import jax
import mujoco
import numpy as np

from pipeline.machine.description import RobotDescription
from pipeline.reaching.tip import tip_pose
from tests.reaching.lag import random_configurations

# Turned bodies, a hinge off its body's origin about a slanted axis, a slide, and a branch that does not carry the tip
ROBOT = """
<mujoco><worldbody>
  <body pos="0.1 0.2 0.3" quat="0.8 0.6 0 0"><joint type="hinge" axis="0 0.6 0.8" pos="0.05 -0.1 0.2"/>
    <geom size="0.1"/>
    <body pos="0 0 0.5"><joint type="hinge" axis="1 0 0"/><geom size="0.1"/></body>
    <body pos="0.4 0 0" quat="0.6 0 0.8 0"><joint type="slide" axis="0 0.8 0.6"/><geom size="0.1"/>
      <body pos="0.2 0.1 0"><joint type="hinge" axis="0 1 0"/><geom size="0.1"/></body>
    </body>
  </body>
</worldbody></mujoco>
"""
TIP = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.5, -0.5, 0.5])


def test_equals_the_arms_kinematics(bobcat, arm, forward):
    q = random_configurations(bobcat, jax.random.key(0), 64).reshape(4, 16, 4)
    expected, got = forward(q), jax.jit(lambda q: tip_pose(arm.description, q))(q)
    np.testing.assert_allclose(got.position, expected.position, rtol=0, atol=3e-6)
    np.testing.assert_allclose(got.quaternion, expected.quaternion, rtol=0, atol=1e-6)


def test_equals_mujoco_for_slides_slanted_axes_and_branches():
    model = mujoco.MjModel.from_xml_string(ROBOT)
    order = np.array([2, 0, 3, 1])  # of the model's joints among the machine's
    description = RobotDescription(Path("none"), model, order, 3, *TIP)
    data = mujoco.MjData(model)
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 4)).astype(np.float32)
    got = jax.jit(lambda q: tip_pose(description, q))(q)
    for index, configuration in enumerate(q):
        data.qpos[:] = configuration[order]
        mujoco.mj_kinematics(model, data)
        link = data.xmat[4].reshape(3, 3)
        np.testing.assert_allclose(got.position[index], data.xpos[4] + link @ TIP[0], rtol=0, atol=5e-6)
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, data.xquat[4], TIP[1])
        same_sign = quaternion * np.sign(quaternion @ np.asarray(got.quaternion[index]))
        np.testing.assert_allclose(got.quaternion[index], same_sign, rtol=0, atol=2e-6)
