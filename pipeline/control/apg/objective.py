"""What an analytic policy gradient minimises: smooth wherever the paper's reward has steps.

The paper's precision bonus and its penalty outside W+ are steps, whose gradient is zero. Logarithms of the errors pull
harder the nearer the target is, and a hinge inside the edges of W+ pushes back before they are crossed.
"""

import jax
import jax.numpy as jnp

from pipeline.control.apg.config import ObjectiveConfig
from pipeline.machine.workspace import depths, workspace_of
from pipeline.reaching.reward import euclidean_norm
from pipeline.reaching.task import Goal, ReachingTask


def cost(
    config: ObjectiveConfig,
    task: ReachingTask,
    goal: Goal,
    q: jax.Array,
    command: jax.Array,
    previous: jax.Array,
) -> jax.Array:
    """Cost of decisions.

    With d, the error of the tip's position, e, that of its pitch, and c, the norm of the joints' errors, each less the
    tolerance, every tick costs d + c + w_p log(d + ε) + w_α log(e + ε) and the hinge at the edges of W+.

    Args:
        config: weights.
        task: kinematics and workspace.
        q: configurations after each tick of a decision, (ticks, ..., n_joint), rad (m).
        command: of the decision, (..., n_joint).
        previous: of the decision before, (..., n_joint).

    Returns:
        The mean over ticks, plus the price of the change of command, (...).
    """
    pose, yaw = task.arm.forward(q), task.arm.yaw(q)

    def beyond(error: jax.Array) -> jax.Array:
        return jax.nn.relu(error - config.tolerance)

    position = beyond(euclidean_norm(goal.pose.position - pose.position))
    pitch = beyond(jnp.abs(task.arm.pitch(q) - task.arm.pitch(goal.configuration)))
    joints = beyond(euclidean_norm(q - goal.configuration))
    missing = sum(
        jax.nn.relu(config.edge_margin_m - depth)
        for depth in depths(workspace_of(task.machine), pose.position, yaw)
    )
    of_tick = (
        position
        + joints
        + config.position_log_weight * jnp.log(position + config.log_floor)
        + config.pitch_log_weight * jnp.log(pitch + config.log_floor)
        + config.edge_weight * missing
    )
    return of_tick.mean(axis=0) + config.change_weight * jnp.sum((command - previous) ** 2, axis=-1)
