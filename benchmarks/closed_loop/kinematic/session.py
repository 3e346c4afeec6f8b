"""Recorded sessions of kinematic machines, as arrays like those of the plant's."""

from collections.abc import Sequence

import numpy as np

from benchmarks.closed_loop.kinematic.encoder import read_encoders
from benchmarks.closed_loop.kinematic.machine import Encoder, Machine, Motion
from benchmarks.closed_loop.kinematic.operator import Driver, driver
from benchmarks.closed_loop.kinematic.simulator import SUBSTEP_S, advance
from benchmarks.closed_loop.kinematic.state import N_SHARED, resting_state
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
        InputError: The control period is no multiple of the substep, or a machine paints that has no workspace.
    """
    operator_seed, motion_seed = np.random.SeedSequence(seed).spawn(2)
    at_sticks = driver(specification, machine.work, style_seed, int(operator_seed.generate_state(1)[0]))
    return drive(specification, machine, at_sticks, minutes, motion_seed, start_time_ns, changes)


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
    period_s = specification.dt_s
    n_substep = round(period_s / SUBSTEP_S)
    if abs(n_substep * SUBSTEP_S - period_s) > 1e-9:
        raise InputError(
            f"conf/machine/{specification.name}.yaml: rate_hz is {specification.rate_hz}; the kinematic simulator "
            f"needs a period that is a multiple of {SUBSTEP_S} s"
        )
    n, n_period = specification.n_joint, round(minutes * 60.0 / period_s)
    begins_s = period_s * np.arange(n_period)
    start, dead_time, process, extra, publication, noise = (
        np.random.default_rng(stream) for stream in seed.spawn(6)
    )
    quantities = machine.quantities
    state_record = pack(
        resting_state(
            _start_position(start, quantities.motion) if start_rad is None else start_rad,
            process.standard_normal(N_SHARED + n),
        )
    )
    stamp_s = stamps_s(publication, quantities.encoder, n_period * period_s)
    age_draw = publication.uniform(-1.0, 1.0, stamp_s.size)
    noise_draw = noise.standard_normal((stamp_s.size, n))
    jitter = dead_time.uniform(-1.0, 1.0, (n_period, n))
    extra_share = extra.gamma(EXTRA_TIME_SHAPE, 1.0 / EXTRA_TIME_SHAPE, (n_period, n))
    process_draw = process.standard_normal((n_period, N_SHARED + n))

    commands, arrival_s = np.zeros((n_period, n)), np.zeros((n_period, n))
    path_rad = np.zeros((n_period * n_substep + 1, n))
    path_rad[0] = state_record[0].link_rad
    readings_rad = np.zeros((stamp_s.size, n))
    n_read = 0
    measured = path_rad[0]  # until there is a reading, the operator trusts his eyes
    pending = list(changes)
    quantity_record = pack(quantities)
    for period, begin_s in enumerate(begins_s.tolist()):
        while pending and begin_s >= pending[0][0]:
            quantities = pending.pop(0)[1].quantities
            quantity_record = pack(quantities)
        commands[period] = at_sticks.command(measured)
        path = quantities.command_path
        arrival_s[period] = begin_s + path.dead_time_s + path.dead_time_jitter_s * jitter[period]
        advance(
            quantity_record,
            state_record,
            commands,
            arrival_s,
            extra_share,
            process_draw,
            period,
            n_substep,
            start_time_ns / NANOSECONDS,
            path_rad,
        )
        n_read = read_encoders(
            quantity_record[0].encoder,
            path_rad,
            SUBSTEP_S,
            stamp_s,
            age_draw,
            noise_draw,
            n_read,
            begin_s + period_s,
            readings_rad,
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
        command_log_time_ns=absolute_ns(
            begins_s + dead_time.uniform(*COMMAND_LOG_DELAY_S, n_period), start_time_ns
        ),
        commands=commands.astype(np.int8),
        true_positions=path_rad[n_substep::n_substep].copy(),
    )


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
