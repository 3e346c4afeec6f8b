"""`teleoperation_server`: a joystick's sticks become commands (paper, "Data collection for system identification")."""

from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import Component, Condition, Output, Publication, nanoseconds
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    Joystick,
    Level,
    Message,
    Release,
    Topic,
)
from pipeline.deployment.settings import TeleoperationConfig
from pipeline.machine.specification import CommandKind, MachineSpecification


class TeleoperationServer(Component):
    """Sends commands at the control frequency while sticks are deflected, and a last one when they are let go.

    A silent joystick, or one with missing axes, counts as released.
    """

    name = "teleoperation_server"
    subscriptions = (Topic.joystick, Topic.emergency_stop, Topic.release)

    def __init__(self, machine: MachineSpecification, config: TeleoperationConfig) -> None:
        """An interpreter for one machine.

        Raises:
            InputError: the machine has more joints than the sticks have axes.
        """
        self.period_ns = nanoseconds(machine.dt_s)
        self._is_discrete = machine.command_kind is CommandKind.discrete
        self._axes, self._signs = config.sticks(machine)
        self._threshold = config.threshold
        self._maximum_silence_ns = nanoseconds(config.maximum_silence_s)
        self._sticks: Joystick | None = None
        self._received_ns = 0
        self._is_moving = False
        self._latch = StopLatch()
        self._sequence = 0

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Store the sticks' state; from an emergency stop to its release, send no commands."""
        if isinstance(message, Joystick):
            self._sticks, self._received_ns = message, now_ns
        elif isinstance(message, EmergencyStop | Release):
            self._latch.hear(message)
            self._is_moving &= not self._latch.is_closed
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Send the command of the sticks."""
        values = self.command(now_ns)
        moves = bool(values.any())
        if self._latch.is_closed or not (moves or self._is_moving):
            return ()
        self._is_moving = moves
        self._sequence += 1
        command = JointCommand(now_ns, self.name, self._sequence, now_ns, values, is_last=not moves)
        return (Publication(Topic.requested_commands, command),)

    def condition(self, now_ns: int) -> Condition:
        """Whether sticks are heard and deflected."""
        if self._sticks is None or now_ns - self._received_ns > self._maximum_silence_ns:
            return self._latch.condition(Condition(Level.warning, "hears no joystick"))
        text = "sticks are deflected" if self.command(now_ns).any() else "sticks are released"
        return self._latch.condition(Condition(Level.ok, text))

    def command(self, now_ns: int) -> np.ndarray:
        """Command of the present stick deflections, (n_joint,)."""
        idle = np.zeros(len(self._axes), np.float32)
        sticks = self._sticks
        if sticks is None or now_ns - self._received_ns > self._maximum_silence_ns:
            return idle
        if len(sticks.axes) <= self._axes.max() or not np.isfinite(sticks.axes).all():
            return idle
        deflection = self._signs * np.asarray(sticks.axes, float)[self._axes]
        if self._is_discrete:
            return np.where(np.abs(deflection) > self._threshold, np.sign(deflection), 0.0).astype(np.float32)
        return np.clip(deflection, -1.0, 1.0).astype(np.float32)
