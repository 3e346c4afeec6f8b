"""From a target pose to its configuration, which policies observe, too."""

from collections.abc import Callable
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.machine.inverse import solve_inverse
from pipeline.machine.kinematics import Arm, Pose
from pipeline.machine.specification import MachineSpecification

SAME_POSITION_M = 1e-5

GoalSolver = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]


def goal_solver(machine: MachineSpecification, arm: Arm) -> GoalSolver:
    """A function of position (3,), quaternion (4,) and present configuration (n_joint,).

    It returns the nearest configuration that reaches the pose, (n_joint,), float32, or None if the pose is unreachable.
    """

    def solve(position: np.ndarray, quaternion: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        pose = np.concatenate([position, quaternion])
        if not (np.isfinite(pose).all() and np.any(quaternion)):
            return None
        solution = solve_inverse(machine, arm, Pose(jnp.asarray(position), jnp.asarray(quaternion)))
        if not solution.reached:
            return None
        nearest = np.argmin(np.abs(solution.configurations - q).sum(axis=1))
        return solution.configurations[nearest].astype(np.float32)

    return solve


@cache
def compiled_forward(arm: Arm) -> Callable[[np.ndarray], Pose]:
    """The arm's forward kinematics, compiled once per shape of its argument."""
    return jax.jit(arm.forward)


def known_configurations(arm: Arm, targets: np.ndarray) -> GoalSolver:
    """A solver that looks up a pose among those of known configurations, (N, n_joint), float32.

    It serves experiments on fixed episodes, whose targets are given as configurations.
    """
    positions = np.asarray(compiled_forward(arm)(targets).position)

    def solve(position: np.ndarray, quaternion: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        distance = np.abs(positions - position).max(axis=1)
        nearest = int(np.argmin(distance))
        return targets[nearest] if distance[nearest] < SAME_POSITION_M else None

    return solve
