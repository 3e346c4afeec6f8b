"""From a log as recorded to samples that can be resampled; every sample left out or changed is counted.

Rules, in this order:
- Joint samples with a value that is not a number are left out. - A sample whose stamp alone lies far from
both neighbours' is left out (a damaged stamp). - Encoder wrap-around of revolute joints is undone; whole
turns are taken off so that the log lies about the limits. - A spike (one sample away from both neighbours by
more than any joint can move, while those agree) is left out; a
  lasting jump splits the log there.
- A step of the clock back by more than the longest gap splits the log; smaller ones are reordered messages,
which
  are put in order. Of samples with one stamp the first counts.
- Values outside the joint limits are kept and counted: the limits describe the machine, not its encoders. -
Commands outside the machine's set are unknown from their time to the next command: no tuples are made there.
If
  they are many, the configuration is wrong and the log is refused.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.clocks import ClockReport, choose_clock, isolated_stamps, split_at_steps_back
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.machine.specification import CommandKind, JointKind, MachineSpecification

ROUNDING = 1e-6  # a float32 command of full scale may stand a hair beyond 1
TURN = 2 * np.pi


@dataclass(frozen=True)
class Stretch:
    """Samples in order of time, without steps of the clock or jumps of an encoder.

    Attributes:
        time_ns: Strictly ascending, shape (N,), int64.
        q: shape (N, n_joint), float64.
        command_time_ns: Ascending, shape (M,), int64.
        command: shape (M, n_joint), float64; NaN where unknown.
    """

    time_ns: np.ndarray
    q: np.ndarray
    command_time_ns: np.ndarray
    command: np.ndarray


@dataclass(frozen=True)
class ConditionedLog:
    """A log's stretches, what was measured about its clocks, and what was left out or changed."""

    stretches: list[Stretch]
    clock: ClockReport
    notes: list[Note]


def condition(raw: RawLog, machine: MachineSpecification, config: IngestConfig) -> ConditionedLog:
    """Apply the rules above.

    Raises:
        InputError: Too many commands are outside the machine's set, or no joint sample is left.
    """
    time_ns, clock, notes = choose_clock(raw, config.maximum_gap_s, config.maximum_clock_offset_s)
    gap_ns = config.maximum_gap_s * NANOSECONDS
    command = valid_commands(raw, machine, config.maximum_invalid_command_fraction, notes)
    finite = np.isfinite(raw.q)
    keep = finite.all(axis=1)
    for joint, n_finite in zip(machine.joint_names, np.count_nonzero(finite, axis=0), strict=True):
        if n_bad := len(finite) - int(n_finite):
            _left_out(notes, n_bad, f"joint samples: the position of {joint} is not a number")
    stray = keep & isolated_stamps(time_ns, gap_ns)
    if stray.any():
        _left_out(
            notes, int(stray.sum()), f"joint samples: their {clock.used} lies far from both neighbours'"
        )
    keep &= ~stray
    time_ns, q = time_ns[keep], raw.q[keep]
    if len(time_ns) == 0:
        raise InputError(
            f"{raw.path}: no joint sample is left of {len(raw.q)}: none holds numbers for all joints"
        )
    q = unwrap(q, machine, notes)
    joint_eras = split_at_steps_back(time_ns, gap_ns)
    command_eras = split_at_steps_back(raw.command_log_time_ns, gap_ns)
    if len(joint_eras) > 1 or len(command_eras) > 1:
        notes.append(
            Note(NoteKind.changed, "the clock steps back; the log is split there", len(joint_eras) - 1)
        )
    if len(command_eras) != len(joint_eras):
        # One clock stepped and the other did not: which commands act when cannot be told.
        raise InputError(
            f"{raw.path}: the clock steps back {len(joint_eras) - 1} times in the joint samples and "
            f"{len(command_eras) - 1} times in the commands; split the bag at the steps"
        )
    stretches = []
    for joint_era, command_era in zip(joint_eras, command_eras, strict=True):
        order = command_era[np.argsort(raw.command_log_time_ns[command_era], kind="stable")]
        era_ns, era_q = _in_order(time_ns[joint_era], q[joint_era], clock, notes)
        era_ns, era_q, jumps = _without_spikes(era_ns, era_q, machine, config, notes)
        if len(jumps):
            text = "encoder jumps beyond any joint's speed; the log is split there"
            notes.append(Note(NoteKind.changed, text, len(jumps)))
        for piece in np.split(np.arange(len(era_ns)), jumps):
            stretches.append(
                Stretch(era_ns[piece], era_q[piece], raw.command_log_time_ns[order], command[order])
            )
    _note_outside_limits(q, machine, notes)
    return ConditionedLog(stretches, clock, notes)


def valid_commands(
    raw: RawLog, machine: MachineSpecification, maximum_fraction: float, notes: list[Note]
) -> np.ndarray:
    """Return the commands with NaN rows where a value is outside the machine's set.

    Raises:
        InputError: More than `maximum_fraction` of them are.
    """
    command = raw.command
    if machine.command_kind == CommandKind.discrete:
        bad = ~np.isin(command, (-1.0, 0.0, 1.0))
        allowed = "{-1, 0, 1}"
    else:
        bad = ~(np.abs(command) <= 1.0 + ROUNDING)
        command, allowed = np.clip(command, -1.0, 1.0), "[-1, 1]"
    rows: np.ndarray = np.any(bad, axis=1)
    if not rows.any():
        return command
    first = int(np.flatnonzero(rows)[0])
    joint = int(np.flatnonzero(bad[first])[0])
    value, name = raw.command[first, joint], machine.joint_names[joint]
    example = f"{value:g} for {name} at log time {raw.command_log_time_ns[first]} ns"
    if rows.mean() > maximum_fraction:
        raise InputError(
            f"{raw.path}: {int(rows.sum())} of {len(rows)} commands are outside {allowed}, first {example}; "
            f"check commands and command_kind in conf/machine/{machine.name}.yaml"
        )
    text = f"commands outside {allowed} (first {example}): unknown, so no tuples until the next command"
    notes.append(Note(NoteKind.left_out, text, int(rows.sum())))
    return np.where(rows[:, None], np.nan, command)


def unwrap(q: np.ndarray, machine: MachineSpecification, notes: list[Note]) -> np.ndarray:
    """Undo wrap-around of revolute joints and take off whole turns, shape (N, n_joint)."""
    q = q.copy()
    for number, joint in enumerate(machine.joints):
        if JointKind(joint.kind) is not JointKind.revolute:
            continue
        n_wraps = int((np.abs(np.diff(q[:, number])) > np.pi).sum())
        continuous = np.unwrap(q[:, number]) if n_wraps else q[:, number]
        turns = np.round((np.median(continuous) - 0.5 * (joint.lower + joint.upper)) / TURN)
        if turns:
            continuous = continuous - turns * TURN
        if n_wraps or turns:
            text = f"encoder of {joint.name} unwrapped: {n_wraps} wraps, {int(turns)} whole turns taken off"
            notes.append(Note(NoteKind.changed, text, max(n_wraps, 1)))
            q[:, number] = continuous
    return q


def _note_outside_limits(q: np.ndarray, machine: MachineSpecification, notes: list[Note]) -> None:
    furthest = np.maximum(machine.lower - q.min(axis=0), q.max(axis=0) - machine.upper)
    for number, (joint, unit) in enumerate(zip(machine.joint_names, machine.units, strict=True)):
        if furthest[number] > 0:
            own = q[:, number]
            count = int(((own < machine.lower[number]) | (own > machine.upper[number])).sum())
            text = f"joint samples kept although {joint} is outside its limits, by up to {furthest[number]:.2g} {unit}"
            notes.append(Note(NoteKind.attention, text, count))


def _in_order(
    time_ns: np.ndarray, q: np.ndarray, clock: ClockReport, notes: list[Note]
) -> tuple[np.ndarray, np.ndarray]:
    """Sort by time, and of samples with one stamp keep the first."""
    n_back = int((np.diff(time_ns) < 0).sum())
    if n_back:
        notes.append(
            Note(NoteKind.changed, f"joint samples out of order by {clock.used}; put in order", n_back)
        )
        order = np.argsort(time_ns, kind="stable")
        time_ns, q = time_ns[order], q[order]
    first = np.concatenate([[True], np.diff(time_ns) > 0])
    if not first.all():
        _left_out(notes, int((~first).sum()), f"joint samples: their {clock.used} repeats the one before")
    return time_ns[first], q[first]


def _without_spikes(
    time_ns: np.ndarray, q: np.ndarray, machine: MachineSpecification, config: IngestConfig, notes: list[Note]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Leave out spikes; return times, positions, and the rows before which a jump is left."""
    jump = _jumps(time_ns, q, machine, config)
    if not jump.any():
        return time_ns, q, np.zeros(0, dtype=np.int64)
    spike = np.zeros(q.shape, dtype=bool)
    back = np.abs(q[2:] - q[:-2]) <= _reach(time_ns[2:] - time_ns[:-2], machine, config)
    spike[1:-1] = jump[:-1] & jump[1:] & back
    for joint, count in zip(machine.joint_names, spike.sum(axis=0), strict=True):
        if count:
            _left_out(notes, int(count), f"joint samples: the position of {joint} is a spike")
    keep = ~spike.any(axis=1)
    time_ns, q = time_ns[keep], q[keep]
    return time_ns, q, np.flatnonzero(_jumps(time_ns, q, machine, config).any(axis=1)) + 1


def _jumps(
    time_ns: np.ndarray, q: np.ndarray, machine: MachineSpecification, config: IngestConfig
) -> np.ndarray:
    """Return between which samples a joint moves further than it can, shape (N - 1, n_joint), bool."""
    return np.abs(np.diff(q, axis=0)) > _reach(np.diff(time_ns), machine, config)


def _reach(interval_ns: np.ndarray, machine: MachineSpecification, config: IngestConfig) -> np.ndarray:
    """How far each joint can move in given intervals, shape (n, n_joint); at least a control period's way."""
    interval_s = np.maximum(interval_ns / NANOSECONDS, machine.dt_s)
    return config.maximum_speed_ranges_per_s * interval_s[:, None] * (machine.upper - machine.lower)


def _left_out(notes: list[Note], count: int, what: str) -> None:
    notes.append(Note(NoteKind.left_out, what, count))
