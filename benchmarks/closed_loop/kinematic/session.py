"""Recorded sessions of kinematic machines, as arrays like those of the plant's."""

from collections.abc import Sequence
from copy import copy

import numpy as np

from benchmarks.closed_loop.kinematic.encoder import read_encoders
from benchmarks.closed_loop.kinematic.machine import Encoder, Machine, Motion
from benchmarks.closed_loop.kinematic.operator import Driver, driver
from benchmarks.closed_loop.kinematic.simulator import SUBSTEP_S, advance
from benchmarks.closed_loop.kinematic.state import N_SHARED, resting_state
from benchmarks.closed_loop.stretches import at_time
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import NANOSECONDS, SessionLog
from pipeline.plant.records import pack

START_SHARE = (0.3, 0.7)  # of each joint's range in which a session begins
EXTRA_TIME_SHAPE = (
    4.0  # of the gamma distribution of extra times: half of their mean is one standard deviation
)
COMMAND_LOG_DELAY_S = (0.001, 0.007)
READING_LOG_DELAY_S = (0.0008, 0.0028)


def record_session(
    specification: MachineSpecification,
    machine: Machine,
    style_seed: int,
    minutes: float,
    seed: int,
    start_time_ns: int,
    changes: Sequence[tuple[float, Machine]] = (),
) -> SessionLog:
    """Let an operator work with a machine.

    Args:
        specification: Names, limits, rate and workspace.
        machine: At the start.
        style_seed: Of the operator's habits.
        minutes: Duration.
        seed: Of all chances of the session; each kind has a stream of its own, so that two machines meet the same.
        start_time_ns: Absolute time of the session's start.
        changes: Later machines, each with the time since start, s, from which on it holds; ascending.

    Raises:
        InputError: The control period is not a multiple of the substep, or a machine paints that has no workspace.
    """
    operator_seed, motion_seed = np.random.SeedSequence(seed).spawn(2)
    at_sticks = driver(specification, machine.work, style_seed, int(operator_seed.generate_state(1)[0]))
    return drive(specification, machine, at_sticks, minutes, motion_seed, start_time_ns, changes)


def begin(specification: MachineSpecification, machine: Machine, log: SessionLog, seed: int) -> "Run":
    """The recorded session of that seed, at its start."""
    _, motion_seed = np.random.SeedSequence(seed).spawn(2)
    clock_s = float(log.command_log_time_ns[0] // NANOSECONDS)  # sessions start with a second
    return Run(specification, machine, len(log.commands), motion_seed, clock_s)


def drive(
    specification: MachineSpecification,
    machine: Machine,
    at_sticks: Driver,
    minutes: float,
    seed: np.random.SeedSequence,
    start_time_ns: int = 0,
    changes: Sequence[tuple[float, Machine]] = (),
    start_rad: np.ndarray | None = None,
) -> SessionLog:
    """The same with anybody at the sticks, from `start_rad`, (n,), or a drawn configuration."""
    n_period = round(minutes * 60.0 / specification.dt_s)
    run = Run(specification, machine, n_period, seed, start_time_ns / NANOSECONDS, start_rad)
    publication, noise = run.publication, run.noise
    stamp_s = stamps_s(publication, machine.quantities.encoder, n_period * specification.dt_s)
    age_draw = publication.uniform(-1.0, 1.0, stamp_s.size)
    noise_draw = noise.standard_normal((stamp_s.size, specification.n_joint))
    readings_rad, n_read = np.zeros((stamp_s.size, specification.n_joint)), 0
    measured = run.path_rad[0]  # until there is a reading, the operator trusts his eyes
    for period in range(n_period):
        begin_s = specification.dt_s * period
        present = at_time(machine, changes, begin_s)
        encoder = run.advance(period, at_sticks.command(measured), present)
        until_s = begin_s + specification.dt_s
        n_read = read_encoders(
            encoder, run.path_rad, SUBSTEP_S, stamp_s, age_draw, noise_draw, n_read, until_s, readings_rad
        )
        if n_read:
            measured = readings_rad[n_read - 1]
    return SessionLog(
        joint_names=specification.joint_names,
        joint_state_header_stamp_ns=absolute_ns(stamp_s[:n_read], start_time_ns),
        joint_state_log_time_ns=absolute_ns(
            stamp_s[:n_read] + publication.uniform(*READING_LOG_DELAY_S, stamp_s.size)[:n_read], start_time_ns
        ),
        positions=readings_rad[:n_read],
        command_log_time_ns=absolute_ns(run.log_time_s, start_time_ns),
        commands=run.commands.astype(np.int8),
        true_positions=run.path_rad[run.n_substep :: run.n_substep].copy(),
    )


class Run:
    """A machine that is driven, period by period.

    Attributes:
        commands: (T, n) so far.
        path_rad: (T n_substep + 1, n) true joint angles at multiples of the substep.
        log_time_s: (T,) when commands are logged.
    """

    def __init__(
        self,
        specification: MachineSpecification,
        machine: Machine,
        n_period: int,
        seed: np.random.SeedSequence,
        clock_s: float,
        start_rad: np.ndarray | None = None,
    ) -> None:
        """At rest, for so many periods; see `record_session`."""
        self._period_s = specification.dt_s
        self.n_substep = round(self._period_s / SUBSTEP_S)
        if abs(self.n_substep * SUBSTEP_S - self._period_s) > 1e-9:
            raise InputError(
                f"conf/machine/{specification.name}.yaml: rate_hz is {specification.rate_hz}; the kinematic "
                f"simulator needs a period that is a multiple of {SUBSTEP_S} s"
            )
        n, self._clock_s = specification.n_joint, clock_s
        start, dead_time, process, extra, self.publication, self.noise = (
            np.random.default_rng(stream) for stream in seed.spawn(6)
        )
        self._change(machine)
        if start_rad is None:
            start_rad = _start_position(start, machine.quantities.motion)
        self._state = pack(resting_state(start_rad, process.standard_normal(N_SHARED + n)))
        self._arrival_s, self.commands = np.zeros((n_period, n)), np.zeros((n_period, n))
        self._chances(dead_time, extra, process)
        delay_s = dead_time.uniform(*COMMAND_LOG_DELAY_S, n_period)
        self.log_time_s = self._period_s * np.arange(n_period) + delay_s
        self.path_rad = np.zeros((n_period * self.n_substep + 1, n))
        self.path_rad[0] = start_rad

    def _chances(
        self, dead_time: np.random.Generator, extra: np.random.Generator, process: np.random.Generator
    ) -> None:
        n_period, n = self.commands.shape
        self._jitter = dead_time.uniform(-1.0, 1.0, (n_period, n))
        self._extra_share = extra.gamma(EXTRA_TIME_SHAPE, 1.0 / EXTRA_TIME_SHAPE, (n_period, n))
        self._process_draw = process.standard_normal((n_period, N_SHARED + n))

    def _change(self, machine: Machine) -> None:
        self._machine, self._quantities = machine, pack(machine.quantities)

    def advance(self, period: int, command: np.ndarray, machine: Machine) -> Encoder:
        """Run one control period; returns the encoders that read it."""
        if machine is not self._machine:
            self._change(machine)
        self.commands[period] = command
        path = machine.quantities.command_path
        jitter_s = path.dead_time_jitter_s * self._jitter[period]
        self._arrival_s[period] = self._period_s * period + path.dead_time_s + jitter_s
        advance(
            self._quantities,
            self._state,
            self.commands,
            self._arrival_s,
            self._extra_share,
            self._process_draw,
            period,
            self.n_substep,
            self._clock_s,
            self.path_rad,
        )
        encoder: Encoder = self._quantities[0].encoder
        return encoder

    def positions(self, first: int, last: int) -> np.ndarray:
        """(last - first + 1, n) true angles at the begins of periods `first` to `last`, rad."""
        return self.path_rad[first * self.n_substep : last * self.n_substep + 1 : self.n_substep]

    def twin(self, period: int, horizon: int, seed: int) -> "Run":
        """The same state at the begin of a period, for `horizon` periods more with other chances."""
        again = copy(self)
        again._state = self._state.copy()
        again.commands, again._arrival_s = (
            np.concatenate([of[:period], np.zeros((horizon, of.shape[1]))])
            for of in (self.commands, self._arrival_s)
        )
        again.path_rad = np.zeros(((period + horizon) * self.n_substep + 1, self.path_rad.shape[1]))
        again.path_rad[: period * self.n_substep + 1] = self.path_rad[: period * self.n_substep + 1]
        again._chances(*(np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(3)))
        return again


def _start_position(random: np.random.Generator, motion: Motion) -> np.ndarray:
    """Joint angles in the middle of the range, (n,), rad."""
    share = random.uniform(*START_SHARE, motion.lower_rad.size)
    return motion.lower_rad + share * (motion.upper_rad - motion.lower_rad)


def stamps_s(random: np.random.Generator, encoder: Encoder, duration_s: float) -> np.ndarray:
    """When readings are taken over, (N,), s since the session's start; the first at some phase of the period."""
    first_s = encoder.jitter_s + random.uniform(0.0, encoder.period_s)
    n = int((duration_s - first_s - encoder.jitter_s) / encoder.period_s) + 1
    return first_s + encoder.period_s * np.arange(n) + encoder.jitter_s * random.uniform(-1.0, 1.0, n)


def absolute_ns(seconds: np.ndarray, start_time_ns: int) -> np.ndarray:
    return start_time_ns + np.round(seconds * NANOSECONDS).astype(np.int64)
