"""`control_supervisor`: watches commands and joint states, and stops the machine (paper, appendix)."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.deployment.component import Component, Condition, Output, Publication, nanoseconds
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.components.supervision.supervisor_rules import RuleParts, build_rules
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    JointState,
    Joystick,
    Level,
    Message,
    Release,
    Reset,
    SupervisorState,
    Topic,
)
from pipeline.deployment.settings import DeploymentConfig, SupervisorConfig, TeleoperationConfig
from pipeline.machine.specification import MachineSpecification


class ControlSupervisor(Component):
    """Checks every rule at every message and tick; the first violation stops the machine until a reset.

    A reset has two steps. The operator acknowledges the stop by its stamp. From then on all rules are checked anew,
    and sticks and requested commands have to be neutral for `neutral_s`; only then is the stop released. A further
    violation in between is a further stop, with a stamp of its own. While a stop is in force, the sign of life names
    it, which compensates for a lost emergency signal.

    Attributes:
        warned: what rules that only warn objected to last, by their names, since the last acknowledgement.
    """

    name = "control_supervisor"
    subscriptions = (
        Topic.requested_commands,
        Topic.joint_states,
        Topic.joystick,
        Topic.emergency_stop,
        Topic.reset,
    )

    def __init__(
        self,
        machine: MachineSpecification,
        new_rules: Callable[[], Mapping[str, Rule]],
        config: SupervisorConfig,
        teleoperation: TeleoperationConfig,
    ) -> None:
        """A supervisor without a stop.

        Args:
            machine: its joints.
            new_rules: the rules in their first state; called at the start and at every acknowledgement.
            config: periods.
            teleoperation: axes of the sticks, and the threshold within which they are neutral.
        """
        self.period_ns = nanoseconds(config.period_s)
        self._neutral_ns = nanoseconds(config.neutral_s)
        self._axes = np.array(teleoperation.axes[: machine.n_joint])
        self._threshold = teleoperation.threshold
        self._new_rules = new_rules
        self._rules = new_rules()
        self._named = tuple(config.rules)
        self._only_warn = frozenset(config.warnings)
        self.warned: dict[str, str] = {}
        self._are_sticks_neutral = True
        self._neutral_since_ns: int | None = None  # None: not acknowledged
        self._latch = StopLatch()

    @property
    def stop(self) -> EmergencyStop | None:
        """The stop in force."""
        return self._latch.last if self._latch.is_closed else None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Check a command or a joint state, take over another component's stop, or begin a reset."""
        if isinstance(message, JointCommand):
            if np.any(message.values):
                self._begin_waiting(now_ns)
            return self._judge(
                now_ns, {n: rule.on_command(message, now_ns) for n, rule in self._rules.items()}
            )
        if isinstance(message, JointState):
            return self._judge(now_ns, {n: rule.on_state(message, now_ns) for n, rule in self._rules.items()})
        if isinstance(message, Joystick):
            self._wait_for_sticks(now_ns)  # they were not neutral until now
            self._are_sticks_neutral = self._are_neutral(message)
            self._wait_for_sticks(now_ns)
        elif isinstance(message, EmergencyStop):
            self._stop(message)
        elif isinstance(message, Reset):
            return self._reset(message, now_ns)
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Check for missing messages, release a stop whose time is over, and send a sign of life."""
        outputs = [*self._judge(now_ns, {name: rule.on_tick(now_ns) for name, rule in self._rules.items()})]
        self._wait_for_sticks(now_ns)
        since_ns = self._neutral_since_ns
        if self.stop is not None and since_ns is not None and now_ns - since_ns >= self._neutral_ns:
            release = Release(now_ns, self.stop.stamp_ns)
            self._latch.hear(release)
            self._neutral_since_ns = None
            outputs.append(Publication(Topic.release, release))
        rule, stop_ns = (self.stop.rule, self.stop.stamp_ns) if self.stop else ("", 0)
        return [*outputs, Publication(Topic.supervisor_state, SupervisorState(now_ns, rule, stop_ns))]

    def condition(self, now_ns: int) -> Condition:
        """The stop in force or what waits for neutral sticks, and the state of every rule."""
        rules = {f"rule {name}": self._state_of(name) for name in self._named}
        text = f"warned by {', '.join(self.warned)}" if self.warned else "no objection"
        condition = self._latch.condition(Condition(Level.warning if self.warned else Level.ok, text, rules))
        waits = "" if self._neutral_since_ns is None else "acknowledged, waits for neutral sticks; "
        return condition._replace(text=waits + condition.text)

    def _state_of(self, rule: str) -> str:
        if rule not in self._rules:
            return "off: no model, or no floor of it"
        if self.stop is not None and self.stop.rule == rule:
            return f"stopped: {self.stop.detail}"
        return f"warned: {self.warned[rule]}" if rule in self.warned else "no objection"

    def _reset(self, reset: Reset, now_ns: int) -> Sequence[Output]:
        last = self._latch.last
        if last is None or reset.stop_ns > last.stamp_ns:
            return ()
        if not self._latch.is_closed:  # repeated by an operator who missed the release
            return (Publication(Topic.release, Release(now_ns, last.stamp_ns)),)
        if reset.stop_ns == last.stamp_ns and self._neutral_since_ns is None:
            self._rules = self._new_rules()
            self.warned.clear()
            self._neutral_since_ns = now_ns
        return ()

    def _are_neutral(self, sticks: Joystick) -> bool:
        if len(sticks.axes) <= self._axes.max():
            return False
        return bool((np.abs(np.asarray(sticks.axes, float)[self._axes]) <= self._threshold).all())

    def _wait_for_sticks(self, now_ns: int) -> None:
        if not self._are_sticks_neutral:
            self._begin_waiting(now_ns)

    def _begin_waiting(self, now_ns: int) -> None:
        if self._neutral_since_ns is not None:
            self._neutral_since_ns = now_ns

    def _judge(self, now_ns: int, objections: Mapping[str, str | None]) -> Sequence[Output]:
        if self.stop is not None and self._neutral_since_ns is None:
            return ()
        for name, detail in objections.items():
            if detail is None:
                continue
            if name in self._only_warn:
                self.warned[name] = detail
            else:
                stop = EmergencyStop(self._latch.later_than_known(now_ns), name, detail)
                self._stop(stop)
                return (Publication(Topic.emergency_stop, stop),)
        return ()

    def _stop(self, stop: EmergencyStop) -> None:
        known = self._latch.closings
        self._latch.hear(stop)
        if self._latch.closings > known:  # it may be its own, or a former one, that comes late
            self._neutral_since_ns = None


def supervise(
    machine: MachineSpecification, config: DeploymentConfig, directory: Path, model: str | None = None
) -> ControlSupervisor:
    """A supervisor with the configured rules.

    Args:
        machine: its joints, limits and workspace.
        config: section `deployment`.
        directory: where conf/machine lies.
        model: folder of the model that the machine should follow; empty or None: there is none.

    Raises:
        InputError: a rule is unknown, or lacks what it needs.
    """
    parts = RuleParts(machine, config.supervisor, directory, Path(model) if model else None)
    return ControlSupervisor(machine, partial(build_rules, parts), config.supervisor, config.teleoperation)
