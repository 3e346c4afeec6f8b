"""The reaching task on a learned dynamics model, tick by tick and without Brax's interface.

The environment (policy learning), the evaluation and model predictive control all call `ReachingTask.tick`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics, H, MeasuredHistory, P
from pipeline.dynamics.model.specify import check_machine
from pipeline.dynamics.model.stops import Stops
from pipeline.machine.kinematics import Arm, Pose
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import below_lower_plane, contains, workspace_of
from pipeline.reaching.discretise import command_from_proto_action
from pipeline.reaching.reward import (
    Deviation,
    RewardConfig,
    RewardTerms,
    euclidean_norm,
    geodesic_distance,
    reward_terms,
    total_reward,
)


class Goal(NamedTuple):
    """The target: its configuration, shape (..., n_joint), rad (m), and the pose that it maps to."""

    configuration: jax.Array
    pose: Pose


class TaskState(NamedTuple):
    """What the task knows between two ticks; any leading axes.

    Attributes:
        history: the dynamics' own, before the next command.
        pose: of the chisel tip, of `history.q`.
        command: of the last tick, shape (..., n_joint); zero at the start of an episode.
        goal: the target.
    """

    history: MeasuredHistory
    pose: Pose
    command: jax.Array
    goal: Goal


class TickOutcome(NamedTuple):
    """What one tick led to; any leading axes.

    Attributes:
        deviation: from the target.
        inside: whether the pose lies in W+.
        below: whether the tip is below W+'s lower plane.
        terms: every reward term.
        reward: sum of the enabled terms.
    """

    deviation: Deviation
    inside: jax.Array
    below: jax.Array
    terms: RewardTerms
    reward: jax.Array


class ReachingTask:
    """Dynamics, kinematics, workspace and reward put together; pure functions of explicit state.

    The dynamics is the learned model's, except that the joint limits act as end stops: a joint that the model
    carries beyond its limit stays there with zero velocity. The paper is silent on limits; without them a
    policy that holds a command drives the model, and the statistics that normalise observations, far outside
    any data (assumed).
    """

    def __init__(
        self,
        machine: MachineSpecification,
        arm: Arm,
        dynamics: Dynamics[P, H],
        parameters: P,
        reward: RewardConfig,
    ) -> None:
        """Puts the parts together.

        Args:
            machine: joint limits, kind of commands and workspace.
            dynamics: the learned model, of any kind.
            parameters: its parameters; values, not traced.
            reward: weights, thresholds and enabled terms.

        Raises:
            InputError: the model is of another machine, or the machine has no workspace.
        """
        check_machine(dynamics.specification, machine, "model")
        self.machine = machine
        self.arm = arm
        self.dynamics: Dynamics = dynamics
        self.reward = reward
        self.parameters = parameters
        self._workspace = workspace_of(machine)
        self.stops = Stops(np.asarray(machine.lower, np.float32), np.asarray(machine.upper, np.float32))

    @property
    def observation_size(self) -> int:
        """Dimension of an observation: x̃, two poses of seven numbers, two configurations."""
        return self.dynamics.specification.n_features + 2 * (3 + 4) + 2 * self.machine.n_joint

    def begin(self, start: jax.Array, goal: jax.Array) -> TaskState:
        """Start of an episode: at rest in `start`, no history, target `goal`; both (..., n_joint)."""
        return self.begin_at(start, self.arm.forward(start), Goal(goal, self.arm.forward(goal)))

    def begin_at(self, start: jax.Array, pose: Pose, goal: Goal) -> TaskState:
        """As `begin`, with poses that are known already."""
        return TaskState(self.dynamics.at_rest(self.parameters, start), pose, jnp.zeros_like(start), goal)

    def command(self, proto_action: jax.Array) -> jax.Array:
        """The machine's command from a proto-action, both (..., n_joint)."""
        return command_from_proto_action(self.machine.command_kind, proto_action)

    def tick(self, state: TaskState, command: jax.Array) -> tuple[TaskState, TickOutcome]:
        """Advance by one control period under `command` (..., n_joint), which the machine takes as it is."""
        history = self.dynamics.step(self.parameters, state.history, command, self.stops)
        pose = self.arm.forward(history.q)
        outcome = self.outcome(history.q, pose, state.goal, command, state.command)
        return TaskState(history, pose, command, state.goal), outcome

    def hold(self, state: TaskState, command: jax.Array, n_ticks: int) -> tuple[TaskState, TickOutcome]:
        """As `n_ticks` calls of `tick`, up to rounding, at less cost; kinematics and reward of all ticks at once.

        Args:
            state: one in which every command so far was held for `n_ticks`.
            command: (..., n_joint).
            n_ticks: ticks that it is held for.

        Returns:
            The state after the last tick, and what every tick led to, (n_ticks, ...).
        """
        history, q = self.dynamics.hold(self.parameters, state.history, command, n_ticks, self.stops)
        pose = self.arm.forward(q)
        previous = jnp.concatenate([state.command[None], jnp.broadcast_to(command, q[1:].shape)])
        outcome = self.outcome(q, pose, state.goal, command, previous)
        last = jax.tree.map(lambda value: value[-1], pose)
        return TaskState(history, last, command, state.goal), outcome

    def observe(self, state: TaskState) -> jax.Array:
        """o_t (paper, "Observations"), shape (..., observation_size).

        x̃, current position and quaternion, target position and quaternion, current and target configuration.
        The configurations are min-max normalised as they are in x̃ (assumed: the paper does not say).
        """
        normalise = self.dynamics.normalise_position
        return jnp.concatenate(
            [
                self.dynamics.features(state.history),
                state.pose.position,
                state.pose.quaternion,
                state.goal.pose.position,
                state.goal.pose.quaternion,
                normalise(state.history.q),
                normalise(state.goal.configuration),
            ],
            axis=-1,
        )

    def outcome(
        self, q: jax.Array, pose: Pose, goal: Goal, command: jax.Array, previous: jax.Array
    ) -> TickOutcome:
        """What ticks led to that reached `q` (..., n_joint) under `command`, each after the command `previous`."""
        deviation = self._deviation(q, pose, goal)
        inside = contains(self._workspace, pose.position, self.arm.yaw(q))
        terms = reward_terms(self.reward, deviation, command, previous, inside)
        return TickOutcome(
            deviation=deviation,
            inside=inside,
            below=below_lower_plane(self._workspace, pose.position),
            terms=terms,
            reward=total_reward(self.reward, terms),
        )

    def _deviation(self, q: jax.Array, pose: Pose, goal: Goal) -> Deviation:
        # Differences of yaw and pitch are not wrapped: within the limits of an arm that does not turn round
        # they stay below a full turn less any threshold in use.
        return Deviation(
            position=euclidean_norm(goal.pose.position - pose.position),
            rotation=geodesic_distance(goal.pose.quaternion, pose.quaternion),
            yaw=self.arm.yaw(q) - self.arm.yaw(goal.configuration),
            pitch=self.arm.pitch(q) - self.arm.pitch(goal.configuration),
            configuration=q - goal.configuration,
        )
