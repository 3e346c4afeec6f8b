"""Why a goal ends before its time-out (paper, appendix: terminal conditions of `autonomous_server`)."""

from collections import deque

import jax
import numpy as np

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.messages import GoalOutcome
from pipeline.deployment.settings import TerminationConfig
from pipeline.machine.kinematics import Arm
from pipeline.machine.orientation import yaw_pitch
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import contains, workspace_of


class OscillationWatch:
    """Counts reversals of each joint's command within a window of time.

    A reversal is a command opposite to the joint's last nonzero command. The paper's controllers that
    failed on the machine "rapidly alternate the values of certain action components" (section "Sim2Real transfer").
    """

    def __init__(self, window_s: float, reversals: int, n_joint: int) -> None:
        self._window_ns = nanoseconds(window_s)
        self._reversals = reversals
        self._direction = np.zeros(n_joint)
        self._times: list[deque[int]] = [deque() for _ in range(n_joint)]

    def oscillates(self, command: np.ndarray, now_ns: int) -> bool:
        """Add the command of a tick; return whether any joint has reversed too often."""
        sign = np.sign(command)
        for joint in np.flatnonzero(sign * self._direction < 0):
            self._times[joint].append(now_ns)
        self._direction = np.where(sign == 0, self._direction, sign)
        for times in self._times:
            while times and times[0] <= now_ns - self._window_ns:
                times.popleft()
        return max(map(len, self._times)) >= self._reversals


class TerminalConditions:
    """The conditions for one machine; each can be switched off. `begin` creates those of one goal."""

    def __init__(self, machine: MachineSpecification, arm: Arm, config: TerminationConfig) -> None:
        workspace = workspace_of(machine)
        self.config = config
        self.n_joint = machine.n_joint

        def locate(q: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
            position = arm.forward(q).position
            return position, arm.pitch(q), contains(workspace, position, arm.yaw(q))

        self._locate = jax.jit(locate)
        self._pitch_of = jax.jit(lambda quaternion: yaw_pitch(quaternion)[1])

    def begin(self, position: np.ndarray, quaternion: np.ndarray) -> "GoalWatch":
        """Conditions of a goal: target position, m (3,), and quaternion (4,) in {B}."""
        return GoalWatch(self, position, float(self._pitch_of(np.asarray(quaternion))))

    def locate(self, q: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Position of the tip, m (3,), its pitch, rad, and whether the pose lies in W+."""
        position, pitch_rad, inside = self._locate(np.asarray(q, np.float32))
        return np.asarray(position), float(pitch_rad), bool(inside)


class GoalWatch:
    """Terminal conditions of one goal."""

    def __init__(self, conditions: TerminalConditions, position: np.ndarray, pitch_rad: float) -> None:
        self._conditions = conditions
        self._position = position
        self._pitch_rad = pitch_rad
        self._was_inside = False
        config = conditions.config
        self._oscillation = OscillationWatch(
            config.oscillation_window_s, config.oscillation_reversals, conditions.n_joint
        )

    def check(self, q: np.ndarray, command: np.ndarray, now_ns: int) -> GoalOutcome | None:
        """Whether the goal ends at this tick: present configuration and command, each (n_joint,)."""
        config = self._conditions.config
        if config.on_oscillation and self._oscillation.oscillates(command, now_ns):
            return GoalOutcome.oscillated
        if not (config.at_goal or config.outside_workspace):
            return None
        position, pitch_rad, inside = self._conditions.locate(q)
        turn = pitch_rad - self._pitch_rad
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        distance = float(np.linalg.norm(position - self._position))
        if (
            config.at_goal
            and distance < config.position_tolerance_m
            and abs(turn) < config.pitch_tolerance_rad
        ):
            return GoalOutcome.reached
        if config.outside_workspace and self._was_inside and not inside:
            return GoalOutcome.left_workspace
        self._was_inside |= inside
        return None
