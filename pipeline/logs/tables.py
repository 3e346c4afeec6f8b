"""Reads CSV and Parquet logs with the machine's column map."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars

from pipeline.errors import InputError
from pipeline.logs.columns import SECTION_ROWS, ColumnStore
from pipeline.logs.discover import LogEntry, LogFormat
from pipeline.logs.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.raw_log import Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

NANOSECONDS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
SAMPLES, COMMANDS = "samples", "commands"  # tables of the store
READING_FAULTS = (polars.exceptions.PolarsError, OSError, ValueError)


def read_table(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
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
    n_rows = n_unused = 0
    damage = ""
    try:
        for frame in _batches(path, entry.format, (columns.time, *positions, *commands), place):
            n_rows += len(frame)
            time_ns, has_time = _time_ns(frame[columns.time], NANOSECONDS_PER[columns.time_unit])
            streams = {SAMPLES: _numbers(frame, positions), COMMANDS: _numbers(frame, commands)}
            used = np.zeros(len(frame), bool)
            for table, values in streams.items():
                chosen = has_time & ~np.isnan(values).all(axis=1)
                store.append(table, {"time_ns": time_ns[chosen], "value": values[chosen]})
                used |= chosen
            n_unused += int((~used).sum())
    except READING_FAULTS as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        if not n_rows:
            raise InputError(f"{path}: not a readable table ({reason}); repair or remove it") from error
        damage = (
            f"{path.name}: the table is damaged after row {n_rows} ({reason}); the rows before it were read"
        )
    sampled, commanded = store.columns(SAMPLES), store.columns(COMMANDS)
    for what, found in (("positions", sampled), ("commands", commanded)):
        if not found or not len(found["time_ns"]):
            raise InputError(f"{path}: no row holds a time and {what}; check the column map in {place}")
    notes = [Note(NoteKind.damage, damage)] if damage else []
    if n_unused:
        text = f"{path.name}: {n_unused} rows left out: they hold no time, or neither positions nor commands"
        notes.append(Note(NoteKind.left_out, text, n_unused))
    return RawLog(
        name=entry.name,
        path=entry.path,
        joint_stamp_ns=sampled["time_ns"],
        joint_log_time_ns=sampled["time_ns"],
        q=sampled["value"],
        command_log_time_ns=commanded["time_ns"],
        command=commanded["value"],
        message_counts={path.name: n_rows},
        notes=tuple(notes),
    )


def _batches(
    path: Path, table_format: LogFormat, wanted: tuple[str, ...], place: str
) -> Iterator[polars.DataFrame]:
    """Yield the wanted columns, some ten thousand rows at a time."""
    if table_format is LogFormat.parquet:
        table = polars.scan_parquet(path)
    else:
        # Everything as text: a stray word in a column then costs its row, not the file.
        table = polars.scan_csv(path, infer_schema=False, truncate_ragged_lines=True, encoding="utf8-lossy")
    seen = table.collect_schema().names()
    missing = [name for name in wanted if name not in seen]
    if missing:
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; map it in {place}; columns seen: {', '.join(seen)}"
        )
    yield from table.select(list(dict.fromkeys(wanted))).collect_batches(
        chunk_size=SECTION_ROWS, maintain_order=True, lazy=True
    )


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
    number = _cast(text, polars.Float64).fill_null(float("nan")).to_numpy()
    limit = MAXIMUM_TIME_NS // nanoseconds
    valid = np.isfinite(number) & (np.abs(number) < limit)
    # Whole units and the rest apart: seconds since 1970 with nanoseconds do not fit into a float64.
    units = np.floor(np.where(valid, number, 0.0))
    rest = np.where(valid, number, 0.0) - units
    time_ns = units.astype(np.int64) * nanoseconds + np.rint(rest * nanoseconds).astype(np.int64)
    if column.dtype not in (polars.Float64, polars.Float32):
        whole = _cast(text, polars.Int64)  # exact, where a float64 of nanoseconds since 1970 is not
        is_whole = whole.is_not_null().to_numpy()
        exact = whole.fill_null(0).clip(-limit, limit).to_numpy() * nanoseconds
        time_ns = np.where(is_whole, exact, time_ns)
    return time_ns, valid


def _cast(column: polars.Series, dtype: type[polars.DataType]) -> polars.Series:
    if column.dtype.is_temporal():
        column = column.cast(polars.Datetime("ns")).cast(polars.Int64)
    try:
        return column.cast(dtype, strict=False)
    except polars.exceptions.PolarsError as error:
        raise InputError(f"column {column.name} holds {column.dtype}, not numbers") from error
