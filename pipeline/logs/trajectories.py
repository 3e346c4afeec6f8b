"""From a log to its trajectories: conditioning, the grid, velocities, the split."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.conditioning.clocks import ClockReport, extremes_without_outliers
from pipeline.logs.conditioning.conditioned_log import COMMAND_INTERVALS, JOINT_INTERVALS, ConditionedLog
from pipeline.logs.conditioning.order_statistics import quantiles
from pipeline.logs.conditioning.resample import GridRows, resample
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig, LoopTrackerState, initial_state
from pipeline.logs.messages.columns import Column, ColumnStore, MemoryStore, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog, TargetPoses, first_loss
from pipeline.logs.tracked_velocities import continue_tracking
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

GRID = "grid"  # table of the store


@dataclass(frozen=True)
class GriddedLog:
    """A log on the machine's grid, with rows in memory or on disk.

    Attributes:
        name: The bag's name.
        start_ns: The bag's start by log time.
        end_ns: The bag's end by log time.
        stamp_ns: Times of the rows of all trajectories in sequence, a column of shape (T,), int64.
        q: Positions, a column of shape (T, n_joint).
        a: Commands in force, a column of shape (T, n_joint).
        x: Channels, a column of shape (T, n_channel); NaN where none holds. None without channels.
        lost_channels: Indices of channels that cannot be assigned to rows.
        lengths: Rows of each trajectory.
        clock: Measurements of the log's clocks.
        joint_intervals_ns: Between joint samples in order of time, a column of shape (n,), int64.
        command_intervals_ns: Between commands, likewise.
        notes: Damage, losses, changes and irregularities.
    """

    name: str
    start_ns: int
    end_ns: int
    stamp_ns: Column
    q: Column
    a: Column
    lengths: list[int]
    clock: ClockReport
    joint_intervals_ns: Column
    command_intervals_ns: Column
    notes: list[Note]
    x: Column | None = None
    lost_channels: tuple[int, ...] = ()


@dataclass(frozen=True)
class LogTrajectories:
    """A log's trajectories in memory, in time order, its target poses, and notes."""

    trajectories: list[Trajectory]
    clock: ClockReport
    notes: list[Note]
    targets: TargetPoses | None = None
    name: str = ""


def grid_log(
    raw: RawLog,
    machine: MachineSpecification,
    config: IngestConfig,
    store: ColumnStore,
    section_rows: int | None = None,
) -> GriddedLog:
    """Condition a log and put it on the grid (contract, section 2), section by section.

    Args:
        config: The rules' thresholds.
        store: Stores the rows.
        section_rows: Samples processed at a time; the result does not depend on it.

    Raises:
        InputError: The log yields no trajectory, or cannot be used; with what was lost or looks wrong.
    """
    conditioned = ConditionedLog(raw, machine, config, store, section_rows)
    try:
        return _gridded(conditioned, machine, config, store)
    except InputError as error:
        likely = [note for note in conditioned.notes if note.kind is NoteKind.warning]
        raise InputError(f"{error}{first_loss([*raw.notes, *likely])}") from error


def _gridded(
    conditioned: ConditionedLog, machine: MachineSpecification, config: IngestConfig, store: ColumnStore
) -> GriddedLog:
    raw = conditioned.raw
    notes = [*raw.notes]
    rows = resample(
        conditioned.joints,
        conditioned.commands,
        machine.dt_s,
        config.maximum_gap_s,
        conditioned.notes,
        conditioned.channels,
    )
    minimum_rows = max(1, round(config.minimum_trajectory_s * machine.rate_hz))
    lengths: list[int] = []
    short: list[int] = []
    for _, stretch in itertools.groupby(_known_stretches(rows), lambda part: part.segment):
        n_rows = 0
        pending: list[GridRows] = []  # while the stretch may be too short
        for part in stretch:
            n_rows += len(part)
            pending.append(part)
            if n_rows >= minimum_rows:
                for settled in pending:
                    x = {} if settled.x is None else {"x": settled.x}
                    store.append(GRID, {"stamp_ns": settled.stamp_ns, "q": settled.q, "a": settled.a, **x})
                pending = []
        (lengths if n_rows >= minimum_rows else short).append(n_rows)
    conditioned.finish()
    notes += conditioned.notes
    if short:
        text = f"rows in {len(short)} stretches shorter than {config.minimum_trajectory_s:g} s"
        notes.append(Note(NoteKind.left_out, text, sum(short)))
    if not lengths:
        raise InputError(
            f"{raw.path}: no trajectory: no {config.minimum_trajectory_s:g} s of joint samples without gap follow the "
            f"first command ({len(raw.q)} joint samples{_spacing(store)}, {len(raw.command)} commands)"
        )
    if len(lengths) > 1:
        text = f"the log is split into {len(lengths)} trajectories"
        notes.append(Note(NoteKind.attention, text, len(lengths) - 1))
    gap_ns = round(config.maximum_gap_s * NANOSECONDS)
    extremes = [at_ns for times in conditioned.clocks for at_ns in extremes_without_outliers(times, gap_ns)]
    none = np.zeros(0, np.int64)
    return GriddedLog(
        name=raw.name,
        start_ns=min(extremes, default=0),
        end_ns=max(extremes, default=0),
        **store.columns(GRID),
        lengths=lengths,
        clock=conditioned.clock,
        joint_intervals_ns=store.columns(JOINT_INTERVALS).get("interval_ns", none),
        command_intervals_ns=store.columns(COMMAND_INTERVALS).get("interval_ns", none),
        notes=notes,
        lost_channels=tuple(conditioned.lost_channels),
    )


def channel_values(gridded: GriddedLog, begin: int, end: int, n_channel: int) -> np.ndarray:
    """Return the channels of some rows, shape (end - begin, n_channel), float64; NaN where none holds."""
    if gridded.x is None:
        return np.full((end - begin, n_channel), np.nan)
    x = np.array(gridded.x[begin:end])
    x[:, list(gridded.lost_channels)] = np.nan
    return x


def trajectory_sections(
    gridded: GriddedLog,
    machine: MachineSpecification,
    config: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    section_rows: int | None = None,
) -> Iterator[Trajectory]:
    """Yield the trajectories with their velocities and their split, in consecutive sections.

    Args:
        gridded: The log on the grid.
        config: The share of rows for validation.
        loop_tracker: Gains of the velocity estimate.
        section_rows: Rows of a section.
    """
    begin = 0
    for number, length in enumerate(gridded.lengths):
        name = gridded.name if number == 0 else f"{gridded.name}#{number}"
        state: LoopTrackerState | None = None
        columns = (gridded.stamp_ns, gridded.q, gridded.a)
        first_row = 0
        for stamp_ns, q, a in sections(columns, begin, begin + length, section_rows):
            state, qd = continue_tracking(state or initial_state(q[0]), q, machine.dt_s, loop_tracker)
            rows = np.arange(first_row, first_row + len(q))
            x = channel_values(gridded, begin + first_row, begin + first_row + len(q), len(machine.channels))
            yield Trajectory(
                name=name,
                t_s=(stamp_ns - gridded.start_ns) / NANOSECONDS,
                stamp_ns=stamp_ns,
                q=q,
                qd=qd,
                a=a,
                is_validation=rows >= first_validation_row(length, config.validation_fraction),
                channels=dict(zip(machine.channel_names, x.T, strict=True)),
            )
            first_row += len(q)
        begin += length


def make_trajectories(
    raw: RawLog,
    machine: MachineSpecification,
    config: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    section_rows: int | None = None,
) -> LogTrajectories:
    """Turn one log into trajectories in memory.

    Raises:
        InputError: The log yields no trajectory.
    """
    gridded = grid_log(raw, machine, config, MemoryStore(), section_rows)
    longest = max(gridded.lengths)
    trajectories = list(trajectory_sections(gridded, machine, config, loop_tracker, longest))
    return LogTrajectories(trajectories, gridded.clock, gridded.notes, raw.targets, raw.name)


def load_trajectories(
    directory: Path, machine: MachineSpecification, config: IngestConfig, loop_tracker: LoopTrackerConfig
) -> list[Trajectory]:
    """Read all logs of a folder straight into trajectories; see `load_logs` for arguments and errors."""
    logs = load_logs(directory, machine, config, loop_tracker)
    return [trajectory for log in logs for trajectory in log.trajectories]


def load_logs(
    directory: Path, machine: MachineSpecification, config: IngestConfig, loop_tracker: LoopTrackerConfig
) -> list[LogTrajectories]:
    """Read all logs of a folder straight into trajectories and target poses, in memory.

    Raises:
        InputError: The folder holds no logs, or one of them cannot be used.
    """
    return [
        make_trajectories(read_log(entry, machine, None, config.maximum_gap_s), machine, config, loop_tracker)
        for entry in find_logs(directory)
    ]


def first_validation_row(n_rows: int, fraction: float) -> int:
    """Return the first validation row; the last `fraction` of the rows are for validation."""
    return n_rows - round(fraction * n_rows)


def _spacing(store: ColumnStore) -> str:
    """How far joint samples are apart, which tells of a wrong unit of time."""
    intervals_ns = store.columns(JOINT_INTERVALS).get("interval_ns")
    if intervals_ns is None or not len(intervals_ns):
        return ""
    (median,) = quantiles(lambda: (part / NANOSECONDS for (part,) in sections((intervals_ns,))), [0.5])
    return f", {median:.3g} s apart"


def _known_stretches(rows: Iterable[GridRows]) -> Iterator[GridRows]:
    """Split stretches where the command in force is unknown."""
    number, last = -1, (-1, False)
    for part in rows:
        known = np.isfinite(part.a).all(axis=1)
        bounds = [0, *(np.flatnonzero(np.diff(known)) + 1).tolist(), len(known)]
        for begin, end in itertools.pairwise(bounds):
            this = (part.segment, bool(known[begin]))
            number, last = number + (this != last), this
            if this[1]:
                piece = slice(begin, end)
                x = None if part.x is None else part.x[piece]
                yield GridRows(number, part.stamp_ns[piece], part.q[piece], part.a[piece], x)
