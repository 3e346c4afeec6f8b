"""`control_interface`: passes commands on to the drivers, and mutes them from an emergency signal on."""

from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import Component, Output, Publication, nanoseconds
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    MachineCommand,
    Message,
    SupervisorState,
    Topic,
)
from pipeline.deployment.settings import InterfaceConfig
from pipeline.machine.specification import MachineSpecification


class ControlInterface(Component):
    """The only way to the drivers. Once muted it sends zeros only, until it is started anew.

    It mutes on the supervisor's emergency stop, and by itself on a command that the machine does not take and where
    the supervisor gives no sign of life.
    """

    name = "control_interface"
    subscriptions = (Topic.requested_commands, Topic.emergency_stop, Topic.supervisor_state)

    def __init__(self, machine: MachineSpecification, config: InterfaceConfig) -> None:
        self._machine = machine
        self.period_ns = nanoseconds(config.period_s)
        self._config = config
        self._maximum_silence_ns = nanoseconds(config.maximum_supervisor_silence_s)
        self._zero = np.zeros(machine.n_joint, np.float32)
        self._alive_ns: int | None = None
        self._is_muted = False

    @property
    def is_muted(self) -> bool:
        """Whether it passes nothing on."""
        return self._is_muted

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Commands go on at once; after an emergency stop, and from it on, zeros do."""
        if isinstance(message, EmergencyStop):
            return self._mute(now_ns)
        if isinstance(message, SupervisorState):
            self._alive_ns = message.stamp_ns  # the sender's: clocks that disagree are no supervision either
            return self._mute(now_ns) if message.rule and not self._is_muted else ()
        if not isinstance(message, JointCommand) or self._is_muted:
            return ()
        lost = self._config.supervised and self._is_supervisor_silent(now_ns)
        if lost or not is_command(self._machine, message.values):
            return self._mute(now_ns)
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, message.values)),)

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Look after the supervisor; repeat the zeros while muted."""
        if self._is_muted:
            return self._mute(now_ns)
        # before its first sign of life nothing has been passed on, and nothing will be
        lost = self._config.supervised and self._alive_ns is not None and self._is_supervisor_silent(now_ns)
        return self._mute(now_ns) if lost else ()

    def _is_supervisor_silent(self, now_ns: int) -> bool:
        return self._alive_ns is None or abs(now_ns - self._alive_ns) > self._maximum_silence_ns

    def _mute(self, now_ns: int) -> Sequence[Output]:
        self._is_muted = True
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, self._zero)),)
