"""The rules of the control supervisor: one small class each.

A rule receives every command and joint state with its time of arrival, and is called at every tick of the supervisor.
It returns a violation in words, or None. Limits are those of `SupervisorConfig`.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.supervision.envelope_rule import StaysInEnvelope
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import ModelFloor, read_floor
from pipeline.deployment.components.supervision.residual_rule import FollowsModel
from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.components.supervision.self_collision import SelfCollision
from pipeline.deployment.messages import JointCommand, JointState
from pipeline.deployment.settings import SupervisorConfig
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.errors import InputError
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import Envelope


class CommandFrequency(Rule):
    """Between a server's first and last command, the rate of commands stays within limits."""

    def __init__(self, config: SupervisorConfig) -> None:
        self._maximum_gap_ns = nanoseconds(config.maximum_command_gap_s)
        self._maximum_count = config.maximum_command_rate_hz
        self._last_ns: dict[str, int] = {}
        self._arrivals: deque[int] = deque()

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        if command.is_last:
            self._last_ns.pop(command.source, None)
        else:
            self._last_ns[command.source] = now_ns
        self._arrivals.append(now_ns)
        while self._arrivals[0] <= now_ns - NANOSECONDS:
            self._arrivals.popleft()
        if len(self._arrivals) > self._maximum_count:
            return f"{len(self._arrivals)} commands within a second"
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Look at what has not come."""
        for source, last_ns in self._last_ns.items():
            if now_ns - last_ns > self._maximum_gap_ns:
                return f"no command of {source} for {(now_ns - last_ns) * 1e-9:.3f} s"
        return None


class CommandDelay(Rule):
    """A command arrives in time, and its decision used a recent joint state."""

    def __init__(self, config: SupervisorConfig) -> None:
        self._delay = _Age("command", config.maximum_command_delay_s, config.clock_tolerance_s)
        self._decision = _Age("decision", config.maximum_decision_age_s, config.clock_tolerance_s)

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        return self._delay.check(command.stamp_ns, now_ns) or self._decision.check(
            command.observed_ns, now_ns
        )


class CommandOrder(Rule):
    """A server's commands arrive in sequence, without losses or repetitions."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        last = self._last.get(command.source, command.sequence - 1)
        self._last[command.source] = command.sequence
        if command.sequence != last + 1:
            return f"command {command.sequence} of {command.source} after {last}"
        return None


class CommandValue(Rule):
    """A command is valid for the machine."""

    def __init__(self, machine: MachineSpecification) -> None:
        self._machine = machine

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        if not is_command(self._machine, command.values):
            return f"command {np.asarray(command.values).tolist()} of {command.source}"
        return None


class StateFrequency(Rule):
    """Joint states keep arriving in time, in the order of sampling."""

    def __init__(self, config: SupervisorConfig) -> None:
        self._maximum_gap_ns = nanoseconds(config.maximum_state_gap_s)
        self._delay = _Age("joint state", config.maximum_state_delay_s, config.clock_tolerance_s)
        self._received_ns: int | None = None
        self._stamp_ns: int | None = None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        last_ns, self._stamp_ns, self._received_ns = self._stamp_ns, state.stamp_ns, now_ns
        if last_ns is not None and state.stamp_ns <= last_ns:
            return f"joint state of {(last_ns - state.stamp_ns) * 1e-9:.3f} s before the last one"
        return self._delay.check(state.stamp_ns, now_ns)

    def on_tick(self, now_ns: int) -> str | None:
        """Look at what has not come."""
        if self._received_ns is None or now_ns - self._received_ns <= self._maximum_gap_ns:
            return None
        return f"no joint state for {(now_ns - self._received_ns) * 1e-9:.3f} s"


class EncoderReading(Rule):
    """Readings are finite, and change within the speed of a joint."""

    def __init__(self, machine: MachineSpecification, config: SupervisorConfig) -> None:
        self._machine = machine
        joint_range = machine.upper - machine.lower
        self._speed = config.maximum_speed * joint_range
        self._noise = config.jump_tolerance * joint_range
        self._last: JointState | None = None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        last, self._last = self._last, state
        if not (np.isfinite(state.position).all() and np.isfinite(state.velocity).all()):
            return "an encoder's reading is not finite"
        if last is None or not np.isfinite(last.position).all():
            return None
        step = np.abs(state.position - last.position)
        allowed = self._noise + self._speed * max(state.stamp_ns - last.stamp_ns, 0) * 1e-9
        if (step > allowed).any():
            joint = int(np.argmax(step - allowed))
            name, unit = self._machine.joint_names[joint], self._machine.units[joint]
            return f"encoder of {name} jumped by {step[joint]:.4f} {unit}"
        return None


class FrozenEncoder(Rule):
    """A reading changes while its joint is commanded.

    Joints at a limit are exempt, as the end stop holds them.
    """

    def __init__(self, machine: MachineSpecification, config: SupervisorConfig) -> None:
        self._machine = machine
        self._threshold = config.frozen_command
        self._frozen_after_ns = nanoseconds(config.frozen_after_s)
        self._margin = config.limit_tolerance * (machine.upper - machine.lower)
        self._command = np.zeros(machine.n_joint)
        self._position: np.ndarray | None = None
        self._since_ns = np.zeros(machine.n_joint, np.int64)

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        if is_command(self._machine, command.values):
            self._command = np.asarray(command.values)
        return None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        position = np.asarray(state.position)
        moved = np.ones(self._machine.n_joint, bool) if self._position is None else position != self._position
        at_limit = (position <= self._machine.lower + self._margin) | (
            position >= self._machine.upper - self._margin
        )
        idle = np.abs(self._command) < self._threshold
        self._position = position
        self._since_ns = np.where(moved | at_limit | idle, now_ns, self._since_ns)
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Look at what has not come."""
        if self._position is None:
            return None
        still_ns = now_ns - self._since_ns
        if still_ns.max() <= self._frozen_after_ns:
            return None
        joint = self._machine.joint_names[int(np.argmax(still_ns))]
        return f"encoder of {joint} has not changed for {still_ns.max() * 1e-9:.2f} s of commands"


class JointLimits(Rule):
    """No joint is beyond its limits, or commanded for long while at an end stop.

    Limits are the cylinders' end stops, which operators and policies reach in ordinary use. A reading beyond them
    indicates a fault. Pressing against them is harmful, as pump and relief valve turn all power into heat. A joint
    that is commanded away from its stop leaves it long before the time is over, so the sign of the command does not
    matter. If limits are not end stops, `limit_prediction_s` stops a joint before it passes them.
    """

    def __init__(self, machine: MachineSpecification, config: SupervisorConfig) -> None:
        self._machine = machine
        self._margin = config.limit_tolerance * (machine.upper - machine.lower)
        self._prediction_s = config.limit_prediction_s
        self._maximum_stop_ns = nanoseconds(config.maximum_stop_s)
        self._direction = np.zeros(machine.n_joint)
        self._is_at_stop = np.zeros(machine.n_joint, bool)
        self._since_ns = np.zeros(machine.n_joint, np.int64)

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Look at a command."""
        if is_command(self._machine, command.values):
            direction = np.sign(command.values)
            self._since_ns = np.where(direction == self._direction, self._since_ns, now_ns)
            self._direction = direction
        return None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        lower, upper = self._machine.lower, self._machine.upper
        is_at_stop = (state.position <= lower + self._margin) | (state.position >= upper - self._margin)
        self._since_ns = np.where(self._is_at_stop & is_at_stop, self._since_ns, now_ns)
        self._is_at_stop = is_at_stop
        for q in (state.position, state.position + self._prediction_s * state.velocity):
            outside = (q < lower - self._margin) | (q > upper + self._margin)
            if outside.any():
                joint = int(np.argmax(outside))
                name, unit = self._machine.joint_names[joint], self._machine.units[joint]
                return f"{name} at {state.position[joint]:.3f} {unit} leaves its limits"
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Check how long a joint has been pressed into its stop."""
        pressed_ns = np.where(self._is_at_stop & (self._direction != 0), now_ns - self._since_ns, 0)
        if pressed_ns.max() <= self._maximum_stop_ns:
            return None
        joint = self._machine.joint_names[int(np.argmax(pressed_ns))]
        return f"{joint} has been commanded into its end stop for {pressed_ns.max() * 1e-9:.2f} s"


class LinkClearance(Rule):
    """Links that are not neighbours keep their distance, now and in the near future at the present velocity."""

    def __init__(self, shapes: SelfCollision, config: SupervisorConfig) -> None:
        self._shapes = shapes
        self._clearance_m = config.clearance_m
        self._prediction_s = config.prediction_s
        self._state: JointState | None = None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        self._state = state
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Look at what has not come."""
        state, self._state = (
            self._state,
            None,
        )  # checked per tick, as joint states arrive more often than necessary
        if state is None or not (np.isfinite(state.position).all() and np.isfinite(state.velocity).all()):
            return None
        for q in (state.position, state.position + self._prediction_s * state.velocity):
            distance = self._shapes.clearance(q, self._clearance_m)
            if distance < self._clearance_m:
                return f"links come within {max(distance, 0.0):.3f} m of each other"
        return None


class _Age:
    """Whether a stamp is recent: neither too old nor in the future beyond the clocks' tolerance."""

    def __init__(self, what: str, maximum_s: float, tolerance_s: float) -> None:
        self._what = what
        self._maximum_ns, self._tolerance_ns = nanoseconds(maximum_s), nanoseconds(tolerance_s)

    def check(self, stamp_ns: int, now_ns: int) -> str | None:
        age_ns = now_ns - stamp_ns
        if -self._tolerance_ns <= age_ns <= self._maximum_ns:
            return None
        return f"{self._what} is {age_ns * 1e-9:.3f} s old"


@dataclass(frozen=True)
class RuleParts:
    """What rules are built of; what takes long is built once, as rules are built anew at every reset.

    Attributes:
        machine: joints, limits and workspace.
        config: limits of the rules.
        directory: where conf/machine lies.
        model: folder of the model that the machine should follow; None: there is none.
    """

    machine: MachineSpecification
    config: SupervisorConfig
    directory: Path
    model: Path | None = None

    @cached_property
    def shapes(self) -> SelfCollision:
        """The links' shapes."""
        return SelfCollision(self.machine, self.directory)

    @cached_property
    def envelope(self) -> Envelope:
        """The planned region."""
        return Envelope(self.machine, load_arm(self.machine, self.directory), self.config.envelope)

    @cached_property
    def followed(self) -> tuple[FreeRunningModel, ModelFloor]:
        """The model beside the machine, and its floor."""
        assert self.model is not None and self.config.floor is not None
        floor = read_floor(Path(self.config.floor), dynamics_fingerprint(self.model))
        return FreeRunningModel(*load_dynamics(self.model, self.machine), self.machine), floor

    @property
    def has_floor(self) -> bool:
        """Whether the model's residual can be judged."""
        return self.model is not None and self.config.floor is not None


RULES: dict[str, Callable[[RuleParts], Rule]] = {
    "command_frequency": lambda parts: CommandFrequency(parts.config),
    "command_delay": lambda parts: CommandDelay(parts.config),
    "command_order": lambda parts: CommandOrder(),
    "command_value": lambda parts: CommandValue(parts.machine),
    "state_frequency": lambda parts: StateFrequency(parts.config),
    "encoder_reading": lambda parts: EncoderReading(parts.machine, parts.config),
    "frozen_encoder": lambda parts: FrozenEncoder(parts.machine, parts.config),
    "joint_limits": lambda parts: JointLimits(parts.machine, parts.config),
    "self_collision": lambda parts: LinkClearance(parts.shapes, parts.config),
    "envelope": lambda parts: StaysInEnvelope(parts.envelope, parts.config.envelope_prediction_s),
    "model_residual": lambda parts: FollowsModel(
        parts.machine, *parts.followed, parts.config.false_stop_hours
    ),
}


def build_rules(parts: RuleParts) -> dict[str, Rule]:
    """The active rules by name; `model_residual` is left out where there is no model or no floor.

    Raises:
        InputError: a rule is unknown, or the machine lacks what it needs.
    """
    names = parts.config.rules
    for name in names:
        if name not in RULES:
            raise InputError(f"deployment.supervisor.rules: no rule `{name}`; known are {', '.join(RULES)}")
    return {name: RULES[name](parts) for name in names if name != "model_residual" or parts.has_floor}
