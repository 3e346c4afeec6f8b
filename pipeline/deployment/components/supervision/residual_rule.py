"""The rule of the residual: the machine follows its model."""

from collections import deque
from typing import Any

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import ModelFloor
from pipeline.deployment.components.supervision.motion_window import MotionSteps, evidence
from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.messages import JointCommand, JointState
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification


class FollowsModel(Rule):
    """Of each joint's last motion (`motion_window`), the evidence stays below its limit (`model_floor`)."""

    def __init__(
        self, machine: MachineSpecification, follower: FreeRunningModel, floor: ModelFloor, hours: float
    ) -> None:
        """A rule of a machine at rest.

        Args:
            machine: its joints.
            follower: its model.
            floor: of that model.
            hours: least mean time between two false stops while all joints move.

        Raises:
            InputError: the floor carries fewer hours.
        """
        self._machine, self._follower, self._floor = machine, follower, floor
        if floor.hours < hours:
            raise InputError(
                f"deployment.supervisor.false_stop_hours is {hours:g}: this floor carries {floor.hours:.3g}; "
                "ask for fewer, or measure it for more, on longer logs"
            )
        self._steps = MotionSteps(follower.specification, floor.speed)
        self._dt_ns = nanoseconds(follower.specification.dt_s)
        self.evidence = np.zeros(machine.n_joint)
        self._terms = np.zeros((machine.n_joint, floor.window_steps, 4, self._steps.n_shift))
        self._n_terms = np.zeros(machine.n_joint, int)
        self._commands: deque[tuple[int, np.ndarray]] = deque([(0, np.zeros(machine.n_joint))])
        self._begin()

    def _begin(self) -> None:
        self._history: Any = None
        self._last: JointState | None = None
        self._grid_ns = 0
        self._q: np.ndarray | None = None
        none = np.zeros(self._machine.n_joint)
        self._expected = deque([none] * self._steps.n_shift, maxlen=self._steps.n_shift)
        self._measured: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=self._steps.lead + 1)
        self._n_rows = 0

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Keep a command from its arrival on."""
        if is_command(self._machine, command.values):
            self._commands.append((now_ns, np.asarray(command.values, float)))
        return None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Compare the rows of the model's grid that the newest joint state completes."""
        last, self._last = self._last, state
        if not np.isfinite(state.position).all():
            self._begin()
            return None
        if last is None or not 0 < state.stamp_ns - last.stamp_ns <= NANOSECONDS:
            self._begin()
            self._last, self._grid_ns = state, state.stamp_ns
            return None
        while self._grid_ns <= state.stamp_ns:
            share = (self._grid_ns - last.stamp_ns) / (state.stamp_ns - last.stamp_ns)
            joint = self._compare(last.position + share * (state.position - last.position))
            self._grid_ns += self._dt_ns
            if joint is not None:
                name, limit = self._machine.joint_names[joint], self._floor.limit[joint]
                return (
                    f"{name} no longer follows its model: evidence {self.evidence[joint]:.2f} of {limit:.2f}"
                )
        return None

    def _compare(self, q: np.ndarray) -> int | None:
        """One row, `q` (n_joint,), with which a step's shifts are complete; the joint that no longer follows."""
        told: int | None = None
        if self._q is None:
            self._history = self._follower.begin(q)
        else:
            self._measured.append((self._q, q - self._q))
            if self._n_rows > self._follower.settling_steps + self._steps.lead:
                told = self._judge(*self._measured[0])
        while len(self._commands) > 1 and self._commands[1][0] <= self._grid_ns:
            self._commands.popleft()
        self._history, expected = self._follower.step(self._history, q, self._commands[0][1])
        self._expected.append(expected)
        self._q = q
        self._n_rows += 1
        return told

    def _judge(self, q: np.ndarray, measured: np.ndarray) -> int | None:
        told, around = None, np.stack(self._expected, axis=-1)
        terms = self._steps.terms(around, measured)
        for joint in np.flatnonzero(self._steps.count(q, around, measured)).tolist():
            self._terms[joint, self._n_terms[joint] % self._floor.window_steps] = terms[joint]
            self._n_terms[joint] += 1
            if self._n_terms[joint] >= self._floor.window_steps:
                self.evidence[joint] = evidence(self._terms[joint].sum(axis=0))
                if self.evidence[joint] >= self._floor.limit[joint]:
                    told = joint
        return told
