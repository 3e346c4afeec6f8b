import itertools
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.machine.orientation import quaternion_from_yaw_pitch, yaw_pitch
from tests.machine.reference import chisel_transform, rotation_matrix

LIMITS = np.array([[-0.9, 0.9], [-0.6, 1.2], [-2.4, -0.3], [-2.2, 0.5]])  # contract, section 1
DOWN = np.array([0.0, 0.0, -1.0])

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


def test_float64_pose_equals_the_product_of_transforms(machine_directory, tmp_path):
    """In a process of its own: JAX's precision is a setting of the process."""
    corners = np.array(list(itertools.product(*LIMITS)))
    inside = np.random.default_rng(0).uniform(LIMITS[:, 0], LIMITS[:, 1], (1000, 4))
    q = np.concatenate([corners, inside, np.zeros((1, 4))])
    np.save(tmp_path / "q.npy", q)
    command = [sys.executable, "-m", "tests.machine.float64_poses", machine_directory, tmp_path]
    subprocess.run(
        command, check=True, cwd=machine_directory.parents[1], env=os.environ | {"JAX_ENABLE_X64": "1"}
    )
    found = np.load(tmp_path / "poses.npz")
    assert found["position"].dtype == found["quaternion"].dtype == np.float64
    expected = np.stack([chisel_transform(configuration) for configuration in q])
    assert np.abs(found["position"] - expected[:, :3, 3]).max() < 1e-9
    rotation = np.stack([rotation_matrix(quaternion) for quaternion in found["quaternion"]])
    assert np.abs(rotation @ DOWN - expected[:, :3, 0]).max() < 1e-9
    assert np.abs(rotation[:, :, 1] - expected[:, :3, 1]).max() < 1e-9


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
