"""The reaching task written plainly: one environment, one tick, every window rolled; Brax's own training wrappers.

What `ppo_speed.py` measures this project's environment against. Same reward, same kinematics, same observation and
model; what differs is how it is computed: an environment is written for a single machine and batched by `vmap`,
a tick rolls both windows, forms the whole input of the network and the whole observation, and a decision is
Brax's `EpisodeWrapper` around four such ticks. Episodes replay their first start and target, as Brax's
`AutoResetWrapper` does: that is cheaper than drawing new ones.
"""

from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

from pipeline.dynamics.model.network import apply
from pipeline.machine.poses import PoseTable
from pipeline.machine.workspace import contains, workspace_of
from pipeline.reaching.discretise import discretise
from pipeline.reaching.reward import Deviation, euclidean_norm, geodesic_distance, reward_terms, total_reward
from pipeline.reaching.task import ReachingTask


class PlainEnvironment(Env):
    """The task of a Δq̇ model and a machine with discrete commands, single and tick by tick."""

    def __init__(self, task: ReachingTask, poses: PoseTable) -> None:
        self._task, self._poses, self._workspace = task, poses, workspace_of(task.machine)
        self._specification = task.dynamics.specification

    @property
    def observation_size(self) -> int:
        """Dimension of an observation."""
        return self._task.observation_size

    @property
    def action_size(self) -> int:
        """Number of joints."""
        return self._task.machine.n_joint

    @property
    def backend(self) -> str:
        """As of the project's environment."""
        return "learned"

    def reset(self, rng: jax.Array) -> State:
        """First state of an episode drawn by `rng`."""
        start_key, goal_key = jax.random.split(rng)
        start, pose = self._poses.draw(start_key)
        goal, goal_pose = self._poses.draw(goal_key)
        rows = jnp.zeros((self._specification.lags + 1, self.action_size))
        state = {
            "velocities": rows,
            "commands": rows,
            "q": start,
            "goal": goal,
            "goal_pose": goal_pose,
        }
        zero = jnp.zeros(())
        return State(state, self._observe(state, pose), zero, zero, {"reward": zero})

    def step(self, state: State, action: jax.Array) -> State:
        """One tick under the command that `action` (n_joint,) stands for."""
        task, before = self._task, state.pipeline_state
        command = discretise(action)
        previous = before["commands"][-1]
        commands = jnp.roll(before["commands"], -1, axis=0).at[-1].set(command)
        x = self._features(before["velocities"], commands, before["q"])
        velocity = before["velocities"][-1] + task.dynamics.scale_residual(
            apply(task.dynamics.network, task.parameters, x)
        )
        free = before["q"] + velocity * self._specification.dt_s
        q = jnp.clip(free, jnp.asarray(task.machine.lower), jnp.asarray(task.machine.upper))
        velocity = jnp.where(q == free, velocity, 0.0)
        after = {
            "velocities": jnp.roll(before["velocities"], -1, axis=0).at[-1].set(velocity),
            "commands": commands,
            "q": q,
            "goal": before["goal"],
            "goal_pose": before["goal_pose"],
        }
        pose, arm = task.arm.forward(q), task.arm
        deviation = Deviation(
            position=euclidean_norm(before["goal_pose"].position - pose.position),
            rotation=geodesic_distance(before["goal_pose"].quaternion, pose.quaternion),
            yaw=arm.yaw(q) - arm.yaw(before["goal"]),
            pitch=arm.pitch(q) - arm.pitch(before["goal"]),
            configuration=q - before["goal"],
        )
        inside = contains(self._workspace, pose.position, arm.yaw(q))
        reward = total_reward(task.reward, reward_terms(task.reward, deviation, command, previous, inside))
        return state.replace(
            pipeline_state=after,
            obs=self._observe(after, pose),
            reward=reward,
            metrics={**state.metrics, "reward": reward},
        )

    def _features(self, velocities: jax.Array, commands: jax.Array, q: jax.Array) -> jax.Array:
        dynamics = self._task.dynamics
        return jnp.concatenate(
            [dynamics.normalise_motion(velocities).ravel(), commands.ravel(), dynamics.normalise_position(q)]
        )

    def _observe(self, state: dict, pose: Any) -> jax.Array:
        normalise = self._task.dynamics.normalise_position
        return jnp.concatenate(
            [
                self._features(state["velocities"], state["commands"], state["q"]),
                pose.position,
                pose.quaternion,
                state["goal_pose"].position,
                state["goal_pose"].quaternion,
                normalise(state["q"]),
                normalise(state["goal"]),
            ]
        )
