"""`control_interface`: forwards commands to the drivers, and mutes them after an emergency signal."""

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
    """The only path to the drivers. Once muted it sends only zeros, until it is restarted.

    It mutes on the supervisor's emergency stop, on an invalid command, and on a missing sign of life from the
    supervisor.
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
        """Whether commands are replaced by zeros."""
        return self._is_muted

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Forward commands at once; from an emergency stop on, send zeros."""
        if isinstance(message, EmergencyStop):
            return self._mute(now_ns)
        if isinstance(message, SupervisorState):
            self._alive_ns = (
                message.stamp_ns
            )  # the sender's clock: disagreeing clocks count as missing supervision
            return self._mute(now_ns) if message.rule and not self._is_muted else ()
        if not isinstance(message, JointCommand) or self._is_muted:
            return ()
        lost = self._config.supervised and self._is_supervisor_silent(now_ns)
        if lost or not is_command(self._machine, message.values):
            return self._mute(now_ns)
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, message.values)),)

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Check the supervisor's sign of life; repeat the zeros while muted."""
        if self._is_muted:
            return self._mute(now_ns)
        # nothing is forwarded before its first sign of life
        lost = self._config.supervised and self._alive_ns is not None and self._is_supervisor_silent(now_ns)
        return self._mute(now_ns) if lost else ()

    def _is_supervisor_silent(self, now_ns: int) -> bool:
        return self._alive_ns is None or abs(now_ns - self._alive_ns) > self._maximum_silence_ns

    def _mute(self, now_ns: int) -> Sequence[Output]:
        self._is_muted = True
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, self._zero)),)
