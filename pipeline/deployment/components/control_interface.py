"""`control_interface`: forwards commands to the drivers, and mutes them after an emergency signal."""

from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import NANOSECONDS, Component, Condition, Output, Publication, nanoseconds
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.messages import (
    EmergencyStop,
    InterfaceRule,
    JointCommand,
    Level,
    MachineCommand,
    Message,
    Release,
    SupervisorState,
    Topic,
)
from pipeline.deployment.settings import InterfaceConfig
from pipeline.machine.specification import MachineSpecification


class ControlInterface(Component):
    """The only path to the drivers. Once muted it sends only zeros, until the supervisor releases the stop.

    It mutes on the supervisor's emergency stop, on an invalid command, and on a missing sign of life from the
    supervisor. The last two are stops of its own. A stop that the supervisor does not know a while later, as it was
    restarted or the message was lost, is published again.
    """

    name = "control_interface"
    subscriptions = (
        Topic.requested_commands,
        Topic.emergency_stop,
        Topic.release,
        Topic.supervisor_state,
    )

    def __init__(self, machine: MachineSpecification, config: InterfaceConfig) -> None:
        self._machine = machine
        self.period_ns = nanoseconds(config.period_s)
        self._config = config
        self._maximum_silence_ns = nanoseconds(config.maximum_supervisor_silence_s)
        self._zero = np.zeros(machine.n_joint, np.float32)
        self._alive_ns: int | None = None
        self._latch = StopLatch()
        self._said_ns = 0  # when the supervisor was last told of it, or told of it

    @property
    def is_muted(self) -> bool:
        """Whether commands are replaced by zeros."""
        return self._latch.is_closed

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Forward commands at once; from an emergency stop on, send zeros."""
        if isinstance(message, EmergencyStop):
            return self._take(message, now_ns)
        if isinstance(message, Release):
            self._latch.hear(message)
            return ()
        if isinstance(message, SupervisorState):
            self._alive_ns = (
                message.stamp_ns
            )  # the sender's clock: disagreeing clocks count as missing supervision
            return self._learn_of_stop(message, now_ns)
        if not isinstance(message, JointCommand) or self.is_muted:
            return ()
        if self._config.supervised and self._is_supervisor_silent(now_ns):
            return self._stop_for_silence(now_ns)
        if not is_command(self._machine, message.values):
            detail = f"command {np.asarray(message.values).tolist()} of {message.source}"
            return self._stop(InterfaceRule.invalid_command, detail, now_ns)
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, message.values)),)

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Check the supervisor's sign of life; repeat the zeros while muted."""
        if self.is_muted:
            return self._zeros(now_ns)
        # nothing is forwarded before its first sign of life
        lost = self._config.supervised and self._alive_ns is not None and self._is_supervisor_silent(now_ns)
        return self._stop_for_silence(now_ns) if lost else ()

    def condition(self, now_ns: int) -> Condition:
        """Whether it passes commands on, and the supervisor's silence."""
        silence = "none heard" if self._alive_ns is None else f"{(now_ns - self._alive_ns) / NANOSECONDS:.3f}"
        values = {"supervisor's silence, s": silence}
        if self._config.supervised and self._alive_ns is None:
            return self._latch.condition(Condition(Level.warning, "waits for the supervisor", values))
        return self._latch.condition(Condition(Level.ok, "passes commands on", values))

    def _learn_of_stop(self, state: SupervisorState, now_ns: int) -> Sequence[Output]:
        """Compensate for lost signals: the supervisor's stop here, and a stop of this component there."""
        if state.rule and not self.is_muted:
            return self._take(EmergencyStop(state.stop_ns, state.rule, "signal lost"), now_ns)
        # a sign of life that was on its way meanwhile tells nothing
        has_heard = state.rule or state.stamp_ns - self._said_ns <= self._maximum_silence_ns
        if self.is_muted and self._latch.last is not None and not has_heard:
            self._said_ns = now_ns
            return (Publication(Topic.emergency_stop, self._latch.last),)
        return ()

    def _is_supervisor_silent(self, now_ns: int) -> bool:
        return self._alive_ns is None or abs(now_ns - self._alive_ns) > self._maximum_silence_ns

    def _stop_for_silence(self, now_ns: int) -> Sequence[Output]:
        return self._stop(InterfaceRule.supervisor_silence, "no sign of life of the supervisor", now_ns)

    def _stop(self, rule: str, detail: str, now_ns: int) -> Sequence[Output]:
        stop = EmergencyStop(self._latch.later_than_known(now_ns), rule, detail)
        return (Publication(Topic.emergency_stop, stop), *self._take(stop, now_ns))

    def _take(self, stop: EmergencyStop, now_ns: int) -> Sequence[Output]:
        self._latch.hear(stop)
        self._said_ns = now_ns
        return self._zeros(now_ns) if self.is_muted else ()

    def _zeros(self, now_ns: int) -> Sequence[Output]:
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, self._zero)),)
