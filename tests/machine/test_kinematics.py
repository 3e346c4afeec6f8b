import copy
import itertools
import warnings

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
from brax import base
from brax import kinematics as brax_kinematics
from brax.io import mjcf

from pipeline.machine.chain import read_chain
from pipeline.machine.description import read_urdf
from pipeline.machine.kinematics import Arm
from pipeline.machine.orientation import quaternion_from_yaw_pitch, yaw_pitch
from pipeline.machine.specification import JointKind, JointSpecification
from tests.machine.reference import chisel_transform, rotation_matrix

LIMITS = np.array([[-0.9, 0.9], [-0.6, 1.2], [-2.4, -0.3], [-2.2, 0.5]])  # contract, section 1
DOWN = np.array([0.0, 0.0, -1.0])

# Turned frames, slanted axes, a slide, a fixed link between moving ones, and a branch that does not carry the tip
INERTIA = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
ODD_ROBOT = (
    '<robot name="odd"><link name="base"/>'
    + "".join(
        f'''<link name="{child}">{INERTIA}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>
    <child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'''
        for name, kind, parent, child, xyz, rpy, axis in (
            ("c", "revolute", "plate", "third", "0.2 0.1 0", "0 0 0.7", "0 1 0"),
            ("a", "revolute", "base", "first", "0.1 0.2 0.3", "0.4 -0.5 0.6", "0 0.6 0.8"),
            ("b", "prismatic", "first", "second", "0.4 0 0", "-1.2 0.3 0", "0 0.8 -0.6"),
            ("d", "revolute", "first", "branch", "0 0 0.5", "0 0 0", "1 0 0"),
            ("plate_mount", "fixed", "second", "plate", "0 0.3 0.1", "0.2 0 -0.9", "1 0 0"),
            ("tip_mount", "fixed", "third", "tip", "0.1 -0.2 0.3", "0.5 1.5 -0.5", "1 0 0"),
        )
    )
    + "</robot>"
)

configurations = st.tuples(*(st.floats(lower, upper) for lower, upper in LIMITS)).map(np.array)


@given(q=configurations)
@settings(deadline=None, max_examples=50)
def test_float32_pose_equals_the_product_of_transforms(q, forward):
    pose = forward(jnp.asarray(q, jnp.float32))
    transform = chisel_transform(q)
    assert np.abs(pose.position - transform[:3, 3]).max() < 1e-5
    rotation = rotation_matrix(np.asarray(pose.quaternion, np.float64))
    assert np.abs(rotation @ DOWN - transform[:3, 0]).max() < 1e-5  # the chisel points along -z of its frame
    assert np.abs(rotation[:, 1] - transform[:3, 1]).max() < 1e-5


def test_float64_pose_equals_the_product_of_transforms(arm):
    corners = np.array(list(itertools.product(*LIMITS)))
    inside = np.random.default_rng(0).uniform(LIMITS[:, 0], LIMITS[:, 1], (1000, 4))
    q = np.concatenate([corners, inside, np.zeros((1, 4))])
    found = arm.forward(q)
    assert found.position.dtype == found.quaternion.dtype == np.float64
    expected = np.stack([chisel_transform(configuration) for configuration in q])
    assert np.abs(found.position - expected[:, :3, 3]).max() < 1e-9
    rotation = np.stack([rotation_matrix(quaternion) for quaternion in found.quaternion])
    assert np.abs(rotation @ DOWN - expected[:, :3, 0]).max() < 1e-9
    assert np.abs(rotation[:, :, 1] - expected[:, :3, 1]).max() < 1e-9


def test_equals_braxs_kinematics(bobcat, machine_directory, arm, forward):
    """The paper computes poses with Brax."""
    q = np.random.default_rng(1).uniform(LIMITS[:, 0], LIMITS[:, 1], (100, 4)).astype(np.float32)
    specification = read_urdf(machine_directory / bobcat.arm.urdf)
    specification.compiler.fusestatic = True
    for geom in specification.geoms:
        specification.delete(geom)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Brax System")
        system = mjcf.load_model(specification.compile())
    *_, tip = arm.joints
    frame = base.Transform(pos=jnp.array(tip.position), rot=jnp.array(tip.quaternion))

    def single(q: jax.Array) -> base.Transform:
        links, _ = brax_kinematics.forward(system, q, jnp.zeros(4))
        return links.take(3).do(frame)

    expected, found = jax.jit(jax.vmap(single))(q), forward(q)
    np.testing.assert_allclose(found.position, expected.pos, rtol=0, atol=3e-6)
    np.testing.assert_allclose(found.quaternion, expected.rot, rtol=0, atol=1e-6)


def test_equals_mujoco_for_slides_slanted_axes_fixed_links_and_branches(bobcat, tmp_path):
    path = tmp_path / "odd.urdf"
    path.write_text(ODD_ROBOT)
    machine = copy.deepcopy(bobcat)
    machine.arm.urdf, machine.arm.end_effector, machine.workspace = path.name, "tip", None
    kinds = ("revolute", "prismatic", "revolute", "revolute")  # the last is on the branch
    machine.joints = [
        JointSpecification(n, -2.0, 2.0, JointKind(k)) for n, k in zip("abcd", kinds, strict=True)
    ]
    machine.arm.yaw_joint, machine.arm.pitch_joints = "a", ["c"]
    arm = Arm(machine, read_chain(machine, tmp_path))
    specification = read_urdf(path)
    specification.compiler.fusestatic = False
    model = specification.compile()
    data = mujoco.MjData(model)
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 4))
    position, quaternion = arm.forward(q)
    for index, configuration in enumerate(q):
        for name, value in zip("abcd", configuration, strict=True):
            data.joint(name).qpos[:] = value
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(position[index], data.body("tip").xpos, rtol=0, atol=1e-12)
        assert abs(quaternion[index] @ data.body("tip").xquat) > 1.0 - 1e-12


@given(q=configurations)
@settings(deadline=None, max_examples=50)
def test_quaternion_is_that_of_yaw_and_pitch_with_its_sign(q, arm, forward):
    expected = quaternion_from_yaw_pitch(jnp.float32(arm.yaw(q)), jnp.float32(arm.pitch(q)))
    assert np.abs(forward(jnp.asarray(q, jnp.float32)).quaternion - expected).max() < 1e-5
    assert arm.yaw(q) == q[0]
    assert np.isclose(arm.pitch(q), q[1] + q[2] + q[3] + np.pi / 2, rtol=0, atol=1e-12)


@given(yaw=st.floats(-0.9, 0.9), pitch=st.floats(-3.1, 3.1), sign=st.sampled_from([-1.0, 1.0]))
@settings(deadline=None, max_examples=50)
def test_yaw_and_pitch_are_recovered_from_either_quaternion(yaw, pitch, sign):
    found_yaw, found_pitch = yaw_pitch(sign * quaternion_from_yaw_pitch(jnp.float32(yaw), jnp.float32(pitch)))
    assert abs(found_yaw - yaw) < 2e-6
    assert abs(found_pitch - pitch) < 2e-6


def test_reference_poses_of_the_contract(forward):
    """Zero angles: stretched out, reach 3.05 m; chisel down: identity; bucket out: tip outwards."""
    stretched = forward(jnp.zeros(4))
    assert np.allclose(stretched.position, [0.25 + 1.35 + 0.80 + 0.65, 0.0, 0.50], atol=1e-6)
    down = forward(jnp.array([0.0, 0.0, -np.pi / 2, 0.0]))
    assert np.allclose(down.quaternion, [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    assert np.allclose(down.position, [1.60, 0.0, 0.50 - 0.80 - 0.65], atol=1e-6)
    left = forward(jnp.array([0.5, 0.0, -np.pi / 2, 0.0]))
    assert left.position[1] > 0.0
    out = forward(jnp.array([0.0, 0.0, -np.pi / 2, 0.3]))
    assert out.position[0] > down.position[0]


def test_leading_axes_single_and_transformations(arm, forward):
    q = jnp.asarray(np.random.default_rng(0).uniform(LIMITS[:, 0], LIMITS[:, 1], (2, 3, 4)), jnp.float32)
    batched = forward(q)
    assert batched.position.shape == (2, 3, 3)
    assert batched.quaternion.shape == (2, 3, 4)
    assert np.allclose(batched.position[1, 2], forward(q[1, 2]).position, atol=1e-6)
    assert np.allclose(batched.position[0], jax.jit(jax.vmap(arm.forward))(q[0]).position, atol=1e-6)
    assert arm.yaw(q).shape == arm.pitch(q).shape == (2, 3)


def test_jacobian_equals_central_differences_of_the_reference(arm):
    q = np.array([0.2, 0.5, -1.4, -0.6])
    step = 1e-6
    expected = np.stack(
        [
            (chisel_transform(q + step * e)[:3, 3] - chisel_transform(q - step * e)[:3, 3]) / (2 * step)
            for e in np.eye(4)
        ],
        axis=1,
    )
    differentiate = jax.jit(jax.jacrev(lambda configuration: arm.forward(configuration).position))
    jacobian = differentiate(jnp.asarray(q, jnp.float32))
    assert np.allclose(jacobian, expected, atol=1e-5)
