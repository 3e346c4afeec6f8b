"""`autonomous_server`: pursues target poses with a controller, at a fixed control frequency (paper, appendix).

At every tick it appends the newest joint state to the buffers of x̃ and sends the command in force. Every few ticks
(action repeats) it requests a new decision instead, and sends the decision as soon as it is available. Until then the
previous command stays in force, and the loop goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.deployment.component import (
    Computation,
    ComputingComponent,
    Condition,
    Output,
    Publication,
    nanoseconds,
)
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.controllers import Controller, ControllerState
from pipeline.deployment.components.goals import GoalSolver
from pipeline.deployment.components.state_buffers import StateBuffers
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.components.termination import GoalWatch, TerminalConditions
from pipeline.deployment.messages import (
    CancelGoal,
    EmergencyStop,
    GoalOutcome,
    JointCommand,
    JointState,
    Level,
    Message,
    ReachGoal,
    ReachResult,
    Release,
    TargetPose,
    Topic,
)
from pipeline.dynamics.model.dynamics_model import ModelSpecification
from pipeline.machine.specification import MachineSpecification


class AimRequest(NamedTuple):
    """Request for a goal's configuration, starting from the present one, (n_joint,); `closings` of the latch."""

    goal: ReachGoal
    q: np.ndarray
    closings: int


class Aim(NamedTuple):
    """Result: the target's configuration, (n_joint,), or None; `closings` of the request."""

    goal: ReachGoal
    target: np.ndarray | None
    closings: int


class DecisionRequest(NamedTuple):
    """Request for a decision: goal and joint state."""

    goal_id: int
    observed_ns: int
    state: ControllerState


class Decision(NamedTuple):
    """The controller's answer."""

    goal_id: int
    observed_ns: int
    command: np.ndarray


@dataclass
class _GoalPursuit:
    """A goal in progress: its target's configuration, its conditions, ticks so far, the decision in force."""

    goal_id: int
    target: np.ndarray
    watch: GoalWatch
    ticks: int
    observed_ns: int
    is_deciding: bool = False


class AutonomousServer(ComputingComponent):
    """Pursues one goal at a time; a new goal replaces it without a stop. Unreachable poses are refused.

    A goal that was given before a stop, or while it is in force, ends as stopped: its release starts no motion.
    """

    name = "autonomous_server"
    subscriptions = (Topic.joint_states, Topic.goal, Topic.cancel, Topic.emergency_stop, Topic.release)

    def __init__(
        self,
        machine: MachineSpecification,
        specification: ModelSpecification,
        controller: Controller,
        solve_goal: GoalSolver,
        conditions: TerminalConditions,
        action_repeats: int,
        maximum_ticks: int,
    ) -> None:
        """Puts a server together.

        Args:
            machine: control frequency and kind of commands.
            specification: specification of the controller's model, which sets the buffers' content.
            controller: makes the decisions.
            solve_goal: maps a pose to a configuration.
            conditions: reasons to end before the time-out.
            action_repeats: ticks per decision.
            maximum_ticks: T_reset, the time-out.
        """
        self.period_ns = nanoseconds(machine.dt_s)
        self._machine = machine
        self._controller = controller
        self._solve_goal = solve_goal
        self._conditions = conditions
        self._action_repeats = action_repeats
        self._maximum_ticks = maximum_ticks
        self._buffers = StateBuffers(specification, controller.observer)
        self._idle = np.zeros(machine.n_joint, np.float32)
        self._command = self._idle
        self._sequence = 0
        self._state: JointState | None = None
        self._pursuit: _GoalPursuit | None = None
        self._waiting: ReachGoal | None = None
        self._latch = StopLatch()
        self._last_result = "none"

    def rehearse(self, state: ControllerState, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Run all functions of a goal once, so that nothing is compiled while the machine moves.

        Args:
            state: any state of the machine.
            position: position of any target pose in {B}, m (3,).
            quaternion: orientation of that pose, (4,).
        """
        self._solve_goal(position, quaternion, state.q)
        watch = self._conditions.begin(position, quaternion)
        for _ in range(2):  # the second decision starts from the first one's state
            watch.check(state.q, self._idle, 0)
            self._controller.decide(state)
        self._controller.begin(0)

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Store joint states and goals for the next tick; end the goal on an emergency."""
        if isinstance(message, JointState):
            self._state = message
        elif isinstance(message, ReachGoal):
            if self._latch.is_closed:
                return (self._refuse(message, GoalOutcome.stopped, now_ns),)
            self._waiting = message
        elif isinstance(message, CancelGoal):
            if self._pursuit is not None and self._pursuit.goal_id == message.goal_id:
                return self._finish(GoalOutcome.cancelled, now_ns)
        elif isinstance(message, EmergencyStop):
            self._latch.hear(message)
            return self._end_all(now_ns) if self._latch.is_closed else ()
        elif isinstance(message, Release):
            self._latch.hear(message)
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """One control tick."""
        if self._state is None:
            return ()
        outputs: list[Output] = []
        if self._waiting is not None:
            outputs.append(Computation(AimRequest(self._waiting, self._state.position, self._latch.closings)))
            self._waiting = None
        state = self._state
        self._buffers.push(state.position, state.velocity, self._command)
        pursuit = self._pursuit
        if pursuit is None:
            return outputs
        if pursuit.ticks >= self._maximum_ticks:
            return [*outputs, *self._finish(GoalOutcome.timed_out, now_ns)]
        outcome = pursuit.watch.check(state.position, self._command, now_ns)
        if outcome is not None:
            return [*outputs, *self._finish(outcome, now_ns)]
        decides = pursuit.ticks % self._action_repeats == 0 and not pursuit.is_deciding
        pursuit.ticks += 1
        if not decides:
            return [*outputs, self._send(now_ns, pursuit.observed_ns)]
        pursuit.is_deciding = True
        snapshot = ControllerState(
            self._buffers.motion.copy(),
            self._buffers.commands.copy(),
            np.asarray(state.position, np.float32),
            pursuit.target,
            self._buffers.history,
        )
        return [*outputs, Computation(DecisionRequest(pursuit.goal_id, state.stamp_ns, snapshot))]

    def compute(self, request: AimRequest | DecisionRequest) -> Aim | Decision:
        """Solve for a goal's configuration, or request a decision."""
        if isinstance(request, AimRequest):
            goal = request.goal
            target = self._solve_goal(goal.position, goal.quaternion, request.q)
            return Aim(goal, target, request.closings)
        return Decision(request.goal_id, request.observed_ns, self._controller.decide(request.state))

    def on_computed(self, result: Aim | Decision, now_ns: int) -> Sequence[Output]:
        """Begin the goal, or send the decision and put it in force."""
        if isinstance(result, Aim):
            return self._begin(result, now_ns)
        pursuit = self._pursuit
        if pursuit is None or result.goal_id != pursuit.goal_id:
            return ()  # decision for a cancelled goal
        pursuit.is_deciding = False
        if not is_command(self._machine, result.command):
            return self._finish(GoalOutcome.controller_failed, now_ns)
        self._command = result.command
        pursuit.observed_ns = result.observed_ns
        return (self._send(now_ns, result.observed_ns),)

    def _begin(self, aim: Aim, now_ns: int) -> Sequence[Output]:
        assert self._state is not None
        goal = aim.goal
        if aim.closings != self._latch.closings:
            return (self._refuse(goal, GoalOutcome.stopped, now_ns),)
        if aim.target is None:
            return (self._refuse(goal, GoalOutcome.refused, now_ns),)
        ended: list[Output] = []
        if self._pursuit is not None:
            ended.append(
                self._result(self._pursuit.goal_id, GoalOutcome.cancelled, self._pursuit.ticks, now_ns)
            )
        self._controller.begin(goal.goal_id)
        watch = self._conditions.begin(goal.position, goal.quaternion)
        self._pursuit = _GoalPursuit(goal.goal_id, aim.target, watch, 0, self._state.stamp_ns)
        return [*ended, Publication(Topic.target_pose, TargetPose(now_ns, goal.position, goal.quaternion))]

    def condition(self, now_ns: int) -> Condition:
        """What is pursued, and how the last goal ended."""
        values = {"last goal": self._last_result}
        if self._state is None:
            return self._latch.condition(Condition(Level.warning, "waits for joint states", values))
        if self._pursuit is None:
            return self._latch.condition(Condition(Level.ok, "waits for a goal", values))
        goal, ticks = self._pursuit.goal_id, self._pursuit.ticks
        return self._latch.condition(Condition(Level.ok, f"pursues goal {goal}, tick {ticks}", values))

    def _end_all(self, now_ns: int) -> Sequence[Output]:
        """End the goal in pursuit, and the one that waits for its configuration."""
        waiting, self._waiting = self._waiting, None
        ended = list(self._finish(GoalOutcome.stopped, now_ns)) if self._pursuit is not None else []
        return [*ended, *([self._refuse(waiting, GoalOutcome.stopped, now_ns)] if waiting else [])]

    def _refuse(self, goal: ReachGoal, outcome: GoalOutcome, now_ns: int) -> Publication:
        return self._result(goal.goal_id, outcome, 0, now_ns)

    def _result(self, goal_id: int, outcome: GoalOutcome, n_ticks: int, now_ns: int) -> Publication:
        self._last_result = f"{goal_id}: {outcome}"
        return Publication(Topic.result, ReachResult(now_ns, goal_id, outcome, n_ticks))

    def _finish(self, outcome: GoalOutcome, now_ns: int) -> Sequence[Output]:
        assert self._pursuit is not None
        result = self._result(self._pursuit.goal_id, outcome, self._pursuit.ticks, now_ns)
        observed_ns = self._state.stamp_ns if self._state else now_ns
        self._pursuit = None
        self._command = self._idle
        return [self._send(now_ns, observed_ns, is_last=True), result]

    def _send(self, now_ns: int, observed_ns: int, is_last: bool = False) -> Publication:
        self._sequence += 1
        command = JointCommand(now_ns, self.name, self._sequence, observed_ns, self._command, is_last)
        return Publication(Topic.requested_commands, command)
