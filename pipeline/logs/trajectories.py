"""From a log to its trajectories: conditioning, the grid, velocities, the split."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.bags import read_log
from pipeline.logs.conditioning import ConditionedLog, condition
from pipeline.logs.discover import find_logs
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig, track
from pipeline.logs.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.logs.resample import GridSegment, resample
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass(frozen=True)
class LogTrajectories:
    """A log's trajectories and what was met on the way.

    Attributes:
        trajectories: In time order.
        conditioned: What they were made of.
        notes: Everything lost, left out, changed or odd, from reading on.
    """

    trajectories: list[Trajectory]
    conditioned: ConditionedLog
    notes: list[Note]


def make_trajectories(
    raw: RawLog, machine: MachineSpecification, config: IngestConfig, loop_tracker: LoopTrackerConfig
) -> LogTrajectories:
    """Turn one log into trajectories (contract, section 2).

    Raises:
        InputError: The log yields none.
    """
    conditioned = condition(raw, machine, config)
    notes = [*raw.notes, *conditioned.notes]
    _note_early_samples(conditioned, notes)
    segments = [
        known
        for stretch in conditioned.stretches
        for segment in resample(
            stretch.time_ns,
            stretch.q,
            stretch.command_time_ns,
            stretch.command,
            machine.dt_s,
            config.maximum_gap_s,
        )
        for known in _with_known_commands(segment)
    ]
    minimum_rows = max(1, round(config.minimum_trajectory_s * machine.rate_hz))
    short = [segment for segment in segments if len(segment.stamp_ns) < minimum_rows]
    if short:
        n_rows = sum(len(segment.stamp_ns) for segment in short)
        text = f"rows in {len(short)} stretches shorter than {config.minimum_trajectory_s:g} s"
        notes.append(Note(NoteKind.left_out, text, n_rows))
    segments = [segment for segment in segments if len(segment.stamp_ns) >= minimum_rows]
    if not segments:
        raise InputError(
            f"{raw.path}: no trajectory: no {config.minimum_trajectory_s:g} s of joint samples without gap "
            f"follow the first command ({len(raw.q)} joint samples, {len(raw.command)} commands)"
        )
    if len(segments) > 1:
        text = f"the log is split into {len(segments)} trajectories"
        notes.append(Note(NoteKind.attention, text, len(segments) - 1))
    start_ns = int(min(raw.joint_log_time_ns.min(), raw.command_log_time_ns.min()))
    trajectories = [
        _trajectory(
            raw.name if number == 0 else f"{raw.name}#{number}",
            segment,
            start_ns,
            machine,
            config,
            loop_tracker,
        )
        for number, segment in enumerate(segments)
    ]
    return LogTrajectories(trajectories, conditioned, notes)


def load_trajectories(
    directory: Path, machine: MachineSpecification, config: IngestConfig, loop_tracker: LoopTrackerConfig
) -> list[Trajectory]:
    """Read all logs of a folder straight into trajectories, in memory.

    Raises:
        InputError: The folder holds no logs, or one of them cannot be used.
    """
    return [
        trajectory
        for entry in find_logs(directory)
        for trajectory in make_trajectories(
            read_log(entry, machine), machine, config, loop_tracker
        ).trajectories
    ]


def validation_rows(n_rows: int, fraction: float) -> np.ndarray:
    """Return which rows are for validation: the last `fraction` of them, shape (n_rows,), bool."""
    return np.arange(n_rows) >= n_rows - round(fraction * n_rows)


def _trajectory(
    name: str,
    segment: GridSegment,
    start_ns: int,
    machine: MachineSpecification,
    config: IngestConfig,
    loop_tracker: LoopTrackerConfig,
) -> Trajectory:
    return Trajectory(
        name=name,
        t_s=(segment.stamp_ns - start_ns) / NANOSECONDS,
        stamp_ns=segment.stamp_ns,
        q=segment.q,
        qd=track(segment.q, machine.dt_s, loop_tracker),
        a=segment.a,
        is_validation=validation_rows(len(segment.stamp_ns), config.validation_fraction),
    )


def _with_known_commands(segment: GridSegment) -> list[GridSegment]:
    """Cut a segment where the command in force is unknown."""
    known = np.isfinite(segment.a).all(axis=1)
    if known.all():
        return [segment]
    pieces = np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1)
    return [
        replace(segment, stamp_ns=segment.stamp_ns[piece], q=segment.q[piece], a=segment.a[piece])
        for piece in pieces
        if known[piece[0]]
    ]


def _note_early_samples(conditioned: ConditionedLog, notes: list[Note]) -> None:
    early = sum(
        int((stretch.time_ns < stretch.command_time_ns[0]).sum())
        for stretch in conditioned.stretches
        if len(stretch.command_time_ns)
    )
    if early:
        notes.append(Note(NoteKind.left_out, "joint samples before the first command", early))
