"""Reads CSV and Parquet logs with the machine's column map."""

from pathlib import Path

import numpy as np
import polars

from pipeline.errors import InputError
from pipeline.logs.discover import LogEntry, LogFormat
from pipeline.logs.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.raw_log import Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

NANOSECONDS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


def read_table(entry: LogEntry, machine: MachineSpecification) -> RawLog:
    """Read one table: a row per sample, with the columns that the machine's `columns` names.

    A row may lack the positions or the commands (streams of different rates in one table): it then is a
    sample of the other alone. Rows without time, or with neither, are counted and left out.

    Raises:
        InputError: The file cannot be read, or a column is missing or holds no numbers.
    """
    columns, place = machine.columns, f"conf/machine/{machine.name}.yaml: columns"
    if columns.time_unit not in NANOSECONDS_PER:
        raise InputError(
            f"{place}.time_unit is `{columns.time_unit}`; use one of {', '.join(NANOSECONDS_PER)}"
        )
    positions = [columns.position.replace("{joint}", joint) for joint in machine.joint_names]
    commands = [columns.command.replace("{joint}", joint) for joint in machine.joint_names]
    path = entry.files[0]
    frame = _frame(path, entry.format)
    missing = [name for name in (columns.time, *positions, *commands) if name not in frame.columns]
    if missing:
        seen = ", ".join(frame.columns)
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; map it in {place}; columns seen: {seen}"
        )
    time_ns, has_time = _time_ns(frame[columns.time], NANOSECONDS_PER[columns.time_unit])
    q, a = _numbers(frame, positions), _numbers(frame, commands)
    sampled = has_time & ~np.isnan(q).all(axis=1)
    commanded = has_time & ~np.isnan(a).all(axis=1)
    for what, chosen in (("positions", sampled), ("commands", commanded)):
        if not chosen.any():
            raise InputError(f"{path}: no row holds a time and {what}; check the column map in {place}")
    notes = []
    if n_unused := int((~(sampled | commanded)).sum()):
        text = f"{path.name}: {n_unused} rows left out: they hold no time, or neither positions nor commands"
        notes.append(Note(NoteKind.left_out, text, n_unused))
    return RawLog(
        name=entry.name,
        path=entry.path,
        joint_stamp_ns=time_ns[sampled],
        joint_log_time_ns=time_ns[sampled],
        q=q[sampled],
        command_log_time_ns=time_ns[commanded],
        command=a[commanded],
        message_counts={path.name: len(frame)},
        notes=tuple(notes),
    )


def _frame(path: Path, table_format: LogFormat) -> polars.DataFrame:
    try:
        if table_format is LogFormat.parquet:
            return polars.read_parquet(path)
        # Everything as text: a stray word in a column then costs its row, not the file.
        return polars.read_csv(path, infer_schema=False, truncate_ragged_lines=True, encoding="utf8-lossy")
    except (polars.exceptions.PolarsError, OSError, ValueError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: not a readable table ({reason}); repair or remove it") from error


def _numbers(frame: polars.DataFrame, names: list[str]) -> np.ndarray:
    """Return columns as numbers, NaN where a cell holds none, shape (n_rows, len(names))."""
    parts = []
    for name in names:
        column = frame[name]
        text = column.str.strip_chars() if column.dtype == polars.String else column
        parts.append(_cast(text, polars.Float64).fill_null(float("nan")).to_numpy())
    return np.stack(parts, axis=1)


def _time_ns(column: polars.Series, nanoseconds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times in ns and which rows have one."""
    text = column.str.strip_chars() if column.dtype == polars.String else column
    whole = _cast(text, polars.Int64)
    limit = MAXIMUM_TIME_NS // nanoseconds
    if whole.null_count() == column.null_count() and column.dtype not in (polars.Float64, polars.Float32):
        valid = (whole.is_not_null() & (whole.abs() <= limit)).fill_null(False)
        return (whole.fill_null(0).clip(-limit, limit) * nanoseconds).to_numpy(), valid.to_numpy()
    number = _cast(text, polars.Float64).fill_null(float("nan")).to_numpy()
    valid_number = np.isfinite(number) & (np.abs(number) < limit)
    # Whole units and the rest apart: seconds since 1970 with nanoseconds do not fit into a float64.
    units = np.floor(np.where(valid_number, number, 0.0))
    rest = np.where(valid_number, number, 0.0) - units
    return units.astype(np.int64) * nanoseconds + np.rint(rest * nanoseconds).astype(np.int64), valid_number


def _cast(column: polars.Series, dtype: type[polars.DataType]) -> polars.Series:
    if column.dtype.is_temporal():
        column = column.cast(polars.Datetime("ns")).cast(polars.Int64)
    try:
        return column.cast(dtype, strict=False)
    except polars.exceptions.PolarsError as error:
        raise InputError(f"column {column.name} holds {column.dtype}, not numbers") from error
