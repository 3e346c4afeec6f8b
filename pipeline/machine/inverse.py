"""Inverse kinematics: configurations that reach a pose.

Logs and operators name targets as poses; the policy and its reward also want the target's configuration
(paper, section "Modeling", observations). Computed in float64 with NumPy, which needs no compilation.
"""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm, Pose
from pipeline.machine.orientation import yaw_pitch
from pipeline.machine.specification import MachineSpecification

STEP = 1e-20  # of complex-step derivatives, which are exact (Squire and Trapp 1998)
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
    unit = np.eye(machine.n_joint)
    pitch_gradient = arm.pitch(unit) - arm.pitch(np.zeros(machine.n_joint))

    def residual(q: np.ndarray) -> np.ndarray:
        turn = float(arm.pitch(q)) - pitch
        return np.append(arm.forward(q).position - position, np.arctan2(np.sin(turn), np.cos(turn)))

    def jacobian(q: np.ndarray) -> np.ndarray:
        positions = arm.forward(q + STEP * 1j * unit).position
        return np.vstack([positions.imag.T / STEP, pitch_gradient])

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
