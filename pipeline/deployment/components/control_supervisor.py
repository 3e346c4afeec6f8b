"""`control_supervisor`: watches commands and joint states, and stops the machine (paper, appendix)."""

from collections.abc import Mapping, Sequence

from pipeline.deployment.component import Component, Output, Publication, nanoseconds
from pipeline.deployment.components.supervisor_rules import Rule
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    JointState,
    Message,
    SupervisorState,
    Topic,
)


class ControlSupervisor(Component):
    """Checks every rule at every message and tick; the first violation stops the machine permanently.

    Afterwards its sign of life names the rule, which compensates for a lost emergency signal.
    """

    name = "control_supervisor"
    subscriptions = (Topic.requested_commands, Topic.joint_states)

    def __init__(self, rules: Mapping[str, Rule], period_s: float) -> None:
        self.period_ns = nanoseconds(period_s)
        self._rules = rules
        self.stop: EmergencyStop | None = None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Check a command or a joint state."""
        if isinstance(message, JointCommand):
            return self._judge(
                now_ns, {n: rule.on_command(message, now_ns) for n, rule in self._rules.items()}
            )
        if isinstance(message, JointState):
            return self._judge(now_ns, {n: rule.on_state(message, now_ns) for n, rule in self._rules.items()})
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Check for missing messages, and send a sign of life."""
        stop = self._judge(now_ns, {name: rule.on_tick(now_ns) for name, rule in self._rules.items()})
        rule = self.stop.rule if self.stop else ""
        return [*stop, Publication(Topic.supervisor_state, SupervisorState(now_ns, rule))]

    def _judge(self, now_ns: int, objections: Mapping[str, str | None]) -> Sequence[Output]:
        if self.stop is not None:
            return ()
        for name, detail in objections.items():
            if detail is not None:
                self.stop = EmergencyStop(now_ns, name, detail)
                return (Publication(Topic.emergency_stop, self.stop),)
        return ()
