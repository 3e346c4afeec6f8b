import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.machine.inverse import solve_inverse
from pipeline.machine.kinematics import Pose
from pipeline.machine.poses import PoseConditions, sample_configurations
from tests.machine.reference import ARM_M, BOOM_M, BOOM_PIVOT_OUT_M, BOOM_PIVOT_UP_M, HAMMER_M


def closed_form(position: np.ndarray, pitch: float) -> np.ndarray:
    """The branch with the elbow up, by the law of cosines in the arm's plane."""
    x, y, z = position
    hammer_angle = pitch - np.pi / 2  # of the hammer against the horizontal
    out = np.hypot(x, y) - BOOM_PIVOT_OUT_M - HAMMER_M * np.cos(hammer_angle)
    up = z - BOOM_PIVOT_UP_M - HAMMER_M * np.sin(hammer_angle)
    arm = -np.arccos((out**2 + up**2 - BOOM_M**2 - ARM_M**2) / (2 * BOOM_M * ARM_M))
    boom = np.arctan2(up, out) - np.arctan2(ARM_M * np.sin(arm), BOOM_M + ARM_M * np.cos(arm))
    return np.array([np.arctan2(y, x), boom, arm, hammer_angle - boom - arm])


def test_solution_is_the_closed_form(bobcat, arm, forward):
    for q in sample_configurations(jax.random.key(7), bobcat, arm, PoseConditions(1.047, None, None), 10):
        pose = forward(q)
        solution = solve_inverse(bobcat, arm, Pose(pose.position, -pose.quaternion))
        assert solution.reached
        expected = closed_form(np.asarray(pose.position, np.float64), float(arm.pitch(q)))
        assert np.abs(expected - q).max() < 1e-4
        assert np.abs(solution.configurations - expected).max() < 1e-5
        assert len(solution.configurations) == 1  # the arm's limits leave one branch


def test_unreachable_pose_gives_the_closest_configuration(bobcat, arm):
    down = jnp.array([1.0, 0.0, 0.0, 0.0])
    solution = solve_inverse(bobcat, arm, Pose(jnp.array([4.0, 0.0, 0.5]), down))
    assert not solution.reached
    assert solution.configurations.shape == (1, 4)
    assert solution.position_error_m[0] > 0.9  # the reach is 3.05 m
    assert (solution.configurations >= bobcat.lower - 1e-6).all()
    assert (solution.configurations <= bobcat.upper + 1e-6).all()


def test_pose_without_orientation_is_refused(bobcat, arm):
    with pytest.raises(InputError, match="quaternion"):
        solve_inverse(bobcat, arm, Pose(jnp.ones(3), jnp.zeros(4)))
