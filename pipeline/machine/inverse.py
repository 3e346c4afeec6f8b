"""Inverse kinematics: configurations that reach a pose.

Logs and operators name targets as poses; the policy and its reward also want the target's configuration
(paper, section "Modeling", observations). Computed in float64 with MuJoCo's kinematics, which need no
compilation.
"""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
import mujoco
import numpy as np
from scipy.optimize import least_squares

from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm, Pose
from pipeline.machine.orientation import yaw_pitch
from pipeline.machine.specification import MachineSpecification

START_FRACTION = 0.25  # starts lie this share of the range inside the limits
SOLVER_TOLERANCE = 1e-14  # relative, near float64's precision
SAME_CONFIGURATION = 1e-3  # rad or m: solutions closer than this are one
POSE_TOLERANCE = 1e-5  # m and rad: what counts as reaching a pose, which logs hold in float32 at times


class Solution(NamedTuple):
    """Configurations that come closest to a pose.

    Attributes:
        configurations: shape (n, n_joint), float64, rad (m), within the joint limits; n > 1 where several
            branches reach the pose, n = 1 with the closest configuration found where none does.
        position_error_m: distance of the tip from the pose's position, shape (n,).
        pitch_error_rad: absolute difference in pitch, shape (n,).
        reached: whether the configurations reach the pose.
    """

    configurations: np.ndarray
    position_error_m: np.ndarray
    pitch_error_rad: np.ndarray
    reached: bool


def solve_inverse(machine: MachineSpecification, arm: Arm, pose: Pose) -> Solution:
    """Finds the configurations that reach a pose's position and pitch.

    The yaw is not asked for: it follows from the position (paper, footnote on the yaw angle), and the
    orientation of a pose typed by a person need not agree with it. Bounded least squares on position (m) and
    pitch (rad) from starts spread over the joint limits (Branch, Coleman and Li 1999, as in SciPy); nothing
    is assumed about the arm's structure.

    Args:
        arm: its kinematics.
        pose: one pose in {B}: position (3,) in m, quaternion (4,) of either sign.

    Raises:
        InputError: the pose is not finite, or its quaternion is zero.
    """
    position, quaternion = np.ravel(pose.position).astype(float), np.ravel(pose.quaternion).astype(float)
    if not (np.isfinite(position).all() and np.isfinite(quaternion).all() and quaternion.any()):
        raise InputError(
            f"target pose, position {position.tolist()}, quaternion {quaternion.tolist()}: both must be "
            "finite and the quaternion must not be zero"
        )
    pitch = float(yaw_pitch(jnp.asarray(quaternion))[1])
    lower, upper = machine.lower, machine.upper
    chain = _Chain(machine, arm)

    def residual(q: np.ndarray) -> np.ndarray:
        turn = float(arm.pitch(q)) - pitch
        return np.append(chain.position(q) - position, np.arctan2(np.sin(turn), np.cos(turn)))

    def jacobian(q: np.ndarray) -> np.ndarray:
        return np.vstack([chain.jacobian(q), chain.pitch_gradient])

    found = []
    for fractions in itertools.product((START_FRACTION, 1.0 - START_FRACTION), repeat=machine.n_joint):
        start = lower + np.array(fractions) * (upper - lower)
        fit = least_squares(
            residual,
            start,
            jacobian,
            bounds=(lower, upper),
            xtol=SOLVER_TOLERANCE,
            ftol=SOLVER_TOLERANCE,
            gtol=SOLVER_TOLERANCE,
        )
        found.append((np.linalg.norm(fit.fun[:3]), abs(fit.fun[3]), fit.x))
    found.sort(key=lambda solution: solution[0] + solution[1])
    reaching = [solution for solution in found if max(solution[:2]) < POSE_TOLERANCE]
    distinct = [found[0]]
    for solution in reaching:
        if all(np.abs(solution[2] - other[2]).max() > SAME_CONFIGURATION for other in distinct):
            distinct.append(solution)
    position_error, pitch_error, q = (np.array(column) for column in zip(*distinct, strict=True))
    return Solution(q, position_error, pitch_error, bool(reaching))


class _Chain:
    """Position of the tip and its Jacobian in float64."""

    def __init__(self, machine: MachineSpecification, arm: Arm) -> None:
        self._description = arm.description
        self._data = mujoco.MjData(arm.description.model)
        self._body = arm.description.end_effector_link + 1  # MuJoCo counts the world
        # columns of the file's joints in the machine's order
        self._columns = np.argsort(arm.description.joint_order)
        zero = np.zeros(machine.n_joint)
        self.pitch_gradient = np.array([arm.pitch(row) - arm.pitch(zero) for row in np.eye(machine.n_joint)])

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position of the tip in {B}, m, shape (3,)."""
        self._data.qpos[:] = q[self._description.joint_order]
        mujoco.mj_kinematics(self._description.model, self._data)
        rotation = self._data.xmat[self._body].reshape(3, 3)
        return self._data.xpos[self._body] + rotation @ self._description.end_effector_position

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian of the tip's position, shape (3, n_joint)."""
        point = self.position(q)
        mujoco.mj_comPos(self._description.model, self._data)
        rows = np.zeros((3, self._description.model.nv))
        mujoco.mj_jac(self._description.model, self._data, rows, None, point, self._body)
        return rows[:, self._columns]
