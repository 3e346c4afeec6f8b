"""The rule of the residual: the machine follows its model."""

from collections import deque
from typing import Any

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import BLOCK_STEPS, ModelFloor, MovingSteps
from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.messages import JointCommand, JointState
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

HOUR_S = 3600.0


class FollowsModel(Rule):
    """Joints move as the model expects of the commands, up to its floor (`model_floor`)."""

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
            InputError: a slow joint cannot be told from the floor in its time so seldom wrongly.
        """
        self._machine, self._follower, self._floor = machine, follower, floor
        self._moving = MovingSteps(follower.specification)
        self._dt_ns = nanoseconds(follower.specification.dt_s)
        n_blocks = hours * HOUR_S / follower.specification.dt_s / BLOCK_STEPS * machine.n_joint
        if floor.n_blocks < n_blocks:
            raise InputError(
                f"deployment.supervisor.false_stop_hours is {hours}: this floor carries "
                f"{hours * floor.n_blocks / n_blocks:.3g}; measure it on longer logs, or for a lower speed or a "
                "longer time"
            )
        self.evidence = np.zeros(machine.n_joint)
        self._commands: deque[tuple[int, np.ndarray]] = deque([(0, np.zeros(machine.n_joint))])
        self._begin()

    def _begin(self) -> None:
        self._history: Any = None
        self._last: JointState | None = None
        self._grid_ns = 0
        self._q: np.ndarray | None = None
        self._expected = np.zeros(self._machine.n_joint)
        self._n_rows = 0
        self._block = np.zeros((self._machine.n_joint, 3))  # steps, R, M

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
                    f"{name} no longer follows its model: evidence {self.evidence[joint]:.1f} of {limit:.1f}"
                )
        return None

    def _compare(self, q: np.ndarray) -> int | None:
        """One row: what was expected of the last one against `q` (n_joint,); the joint that no longer follows."""
        told: int | None = None
        if self._q is None:
            self._history = self._follower.begin(q)
        else:
            measured = q - self._q
            counts = self._moving.count(self._q, self._expected, measured)
            counts &= self._n_rows > self._follower.settling_steps
            motion = np.maximum(np.abs(measured), np.abs(self._expected))
            step = np.stack([np.ones_like(q), measured - self._expected, motion], axis=1)
            self._block[counts] += step[counts]
            for joint in np.flatnonzero(self._block[:, 0] >= BLOCK_STEPS).tolist():
                log_e = self._floor.log_e_value(joint, *self._block[joint, 1:])
                self.evidence[joint] = max(self.evidence[joint], 0.0) + log_e
                self._block[joint] = 0.0
                if self.evidence[joint] >= self._floor.limit[joint]:
                    told = joint
        while len(self._commands) > 1 and self._commands[1][0] <= self._grid_ns:
            self._commands.popleft()
        self._history, self._expected = self._follower.step(self._history, q, self._commands[0][1])
        self._q = q
        self._n_rows += 1
        return told
