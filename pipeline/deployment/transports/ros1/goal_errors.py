"""Distance of a configuration from a goal, for the action's feedback."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.deployment.messages import ReachGoal
from pipeline.deployment.transports.ros1.reach_action import GoalErrors
from pipeline.machine.kinematics import Arm
from pipeline.machine.orientation import yaw_pitch


def goal_errors(arm: Arm) -> GoalErrors:
    """A function of configuration, (n_joint,), rad (m), and goal; compiled before it is returned.

    It gives the distance of the tip from the target, m, and the error in pitch in [-pi, pi), rad.
    """

    def errors(q: jax.Array, position: jax.Array, quaternion: jax.Array) -> tuple[jax.Array, jax.Array]:
        turn = arm.pitch(q) - yaw_pitch(quaternion)[1]
        distance = jnp.linalg.norm(arm.forward(q).position - position)
        return distance, (turn + jnp.pi) % (2 * jnp.pi) - jnp.pi

    compiled = jax.jit(errors)

    def of_goal(q: np.ndarray, goal: ReachGoal) -> tuple[float, float]:
        distance_m, pitch_rad = compiled(
            *(np.asarray(a, np.float32) for a in (q, goal.position, goal.quaternion))
        )
        return float(distance_m), float(pitch_rad)

    of_goal(np.zeros(arm.n_joint), ReachGoal(0, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
    return of_goal
