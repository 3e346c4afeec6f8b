"""Recorded sessions: the operator drives the plant, and the content of a log is kept as arrays."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.machines.field import Shift
from pipeline.plant.parameters import Parameters
from pipeline.plant.physics.kinematics import configuration
from pipeline.plant.recording.attended import AttendedPlant, started
from pipeline.plant.recording.channels import measure, true_values
from pipeline.plant.recording.operator import OperatorStyle, ScriptedOperator
from pipeline.plant.simulator import Plant

NANOSECONDS = 1_000_000_000
SESSION_NAME = "%Y-%m-%d-%H-%M-%S"  # of a recording's bag: when it begins


@dataclass
class RecordConfig:
    """Section `record` of the profile."""

    session_minutes: list[float]
    held_out_minutes: float
    first_session: str  # ISO 8601 with time zone
    seed: int

    def __post_init__(self) -> None:
        if not self.session_minutes or any(not minutes > 0.0 for minutes in self.session_minutes):
            raise InputError(
                f"record.session_minutes is {self.session_minutes}; list positive durations in minutes"
            )
        if not self.held_out_minutes > 0.0:
            raise InputError(f"record.held_out_minutes is {self.held_out_minutes}; it must be positive")
        read_moment("record.first_session", self.first_session)
        if self.seed < 0:
            raise InputError(f"record.seed is {self.seed}; it must not be negative")


def read_moment(name: str, text: str) -> datetime:
    """Parse a moment with its time zone.

    Args:
        name: Name of the setting, for the message.
        text: ISO 8601.

    Raises:
        InputError: The text is not a date and time with a time zone.
    """
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise InputError(
            f"{name} is {text}; write date and time with zone, such as 2024-05-06T09:00:00+00:00"
        )
    return moment


@dataclass(frozen=True)
class SessionLog:
    """One session as a bag would hold it. N joint states, M commands; times are absolute, ns."""

    joint_names: tuple[str, ...]  # as published
    joint_state_header_stamp_ns: np.ndarray  # (N,) int64
    joint_state_log_time_ns: np.ndarray  # (N,) int64
    positions: np.ndarray  # (N, n_joint) float64, rad
    command_log_time_ns: np.ndarray  # (M,) int64
    commands: np.ndarray  # (M, n_joint) int8
    true_positions: np.ndarray  # (M, n_joint) float64, rad, at the ends of the control periods; not for bags
    channels: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict
    )  # log times, ns, and values


def record_session(
    machine: MachineSpecification,
    parameters: Parameters,
    style: OperatorStyle,
    minutes: float,
    seed: int,
    start_time_ns: int,
    changes: Sequence[tuple[float, Parameters]] = (),
    progress: Callable[[float], None] | None = None,
    shift: Shift | None = None,
) -> SessionLog:
    """Let an operator paint W+ with a plant.

    Args:
        machine: names, limits, rate and workspace.
        parameters: the plant's quantities at the start.
        style: the operator's habits.
        minutes: duration of the session.
        seed: of the plant's process variation, the operator's choices and the start.
        start_time_ns: absolute time of the session's start.
        changes: later parameters, each with the time since start, s, from which they hold; ascending.
        progress: called about once per simulated second with the simulated time, s.
        shift: starts of the engine, which is not recorded while it is off; None: it starts once, as `parameters` say.

    Returns:
        The log.

    Raises:
        InputError: the machine has no workspace, or its rate is not the plant's.
    """
    if abs(machine.dt_s - parameters.numerics.control_period_s) > 1e-9:
        raise InputError(
            f"conf/machine/{machine.name}.yaml: rate_hz is {machine.rate_hz}; the plant takes commands every "
            f"{parameters.numerics.control_period_s} s"
        )
    operator = ScriptedOperator(machine, style, int(_seeds(seed)[1]))
    plant = session_plant(machine, started(parameters, shift, 1), seed)
    attended = AttendedPlant(plant, parameters, changes, shift)
    measured = plant.state.link_angle_rad.copy()
    true_channels = [true_values(plant)]
    n_step = round(minutes * 60.0 / machine.dt_s)
    per_second = max(round(machine.rate_hz), 1)
    samples, off_s = [], np.zeros(n_step)
    commands = np.zeros((n_step, machine.n_joint), dtype=np.int8)
    for step in range(n_step):
        attended.attend(not commands[max(step - per_second, 0) : step].any())
        off_s[step] = attended.off_s
        commands[step] = operator.command(measured)
        sample = plant.step(commands[step])
        if sample.joint_states.position_rad.size:
            measured = sample.joint_states.position_rad[-1]
        samples.append(sample)
        true_channels.append(true_values(plant))
        if progress is not None and step % per_second == 0:
            progress(plant.time_s)

    def clock(since_start_s: Iterable[np.ndarray]) -> np.ndarray:
        """Absolute times, ns, of times without the engine's pauses, one array per control period."""
        return _absolute([of + off for of, off in zip(since_start_s, off_s, strict=True)], start_time_ns)

    channels = measure(np.array(true_channels), machine.dt_s, seed)
    return SessionLog(
        joint_names=machine.joint_names,
        joint_state_header_stamp_ns=clock(s.joint_states.stamp_s for s in samples),
        joint_state_log_time_ns=clock(s.joint_states.log_s for s in samples),
        positions=np.concatenate([s.joint_states.position_rad for s in samples]),
        command_log_time_ns=clock(s.command_log_s for s in samples),
        commands=commands,
        true_positions=np.concatenate([s.angle_rad for s in samples]),
        channels={
            name: (_absolute([of.log_s + _at(off_s, of.log_s / machine.dt_s)], start_time_ns), of.value)
            for name, of in channels.items()
        },
    )


def session_plant(machine: MachineSpecification, parameters: Parameters, seed: int) -> Plant:
    """The plant of `record_session` with that seed, at the session's start."""
    plant_seed, _, start_seed = _seeds(seed)
    return Plant(parameters, int(plant_seed), start_configuration(machine, int(start_seed)))


def _seeds(seed: int) -> np.ndarray:
    """Of a session's plant, operator and start."""
    return np.random.SeedSequence(seed).generate_state(3)


def start_configuration(machine: MachineSpecification, seed: int) -> np.ndarray:
    """A configuration in the middle of W+, chisel about straight down, (n_joint,), rad.

    Raises:
        InputError: the machine has no workspace.
    """
    if machine.workspace is None:
        raise InputError(f"conf/machine/{machine.name}.yaml: workspace is missing; sessions start inside it")
    random = np.random.default_rng(seed)
    workspace = machine.workspace
    while True:
        share = random.uniform(0.3, 0.7, 3)
        radius = workspace.radius_min_m + share[0] * (workspace.radius_max_m - workspace.radius_min_m)
        height = workspace.z_min_m + share[1] * (workspace.z_max_m - workspace.z_min_m)
        yaw = workspace.yaw_max_rad * (2.0 * share[2] - 1.0)
        q = configuration(np.array([radius, height]), float(random.uniform(-0.3, 0.3)), yaw)
        if q is not None and np.all(q > machine.lower) and np.all(q < machine.upper):
            return q


def _at(off_s: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """How long the engine had been off at times in control periods since the start, s."""
    return off_s[np.minimum(periods.astype(np.int64), len(off_s) - 1)]


def _absolute(seconds: list[np.ndarray], start_time_ns: int) -> np.ndarray:
    return start_time_ns + np.round(np.concatenate(seconds) * NANOSECONDS).astype(np.int64)
