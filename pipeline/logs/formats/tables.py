"""Read CSV and Parquet logs with the machine's column map."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars

from pipeline.errors import InputError
from pipeline.logs.formats.discover import LogEntry, LogFormat
from pipeline.logs.messages.columns import SECTION_ROWS, ColumnStore
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

NANOSECONDS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
SAMPLES, COMMANDS = "samples", "commands"  # tables of the store
READING_FAULTS = (polars.exceptions.PolarsError, OSError, ValueError)
PIECE_BYTES = 1 << 22  # longer than any line of a table
SMALLEST_SLICE = 64  # rows; smallest slice of a damaged table that is tried
LISTED_COLUMNS, LISTED_CHARACTERS = 24, 40


def read_table(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
    """Read one table: a row per sample, with the columns that the machine's `columns` names.

    A row may lack the positions or the commands (streams of different rates in one table); it is then a sample of the
    other stream alone. Rows without time, or with neither, are counted and dropped.

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
    damage: list[str] = []
    try:
        for frame in _batches(path, entry.format, (columns.time, *positions, *commands), place, damage):
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
        damage.append(f"the table is damaged after row {n_rows} ({reason}); the rows before it were read")
    sampled, commanded = store.columns(SAMPLES), store.columns(COMMANDS)
    for what, found in (("positions", sampled), ("commands", commanded)):
        if not found or not len(found["time_ns"]):
            raise InputError(f"{path}: no row holds a time and {what}; check the column map in {place}")
    notes = [Note(NoteKind.damage, f"{path.name}: {text}") for text in damage]
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
    path: Path, table_format: LogFormat, wanted: tuple[str, ...], place: str, damage: list[str]
) -> Iterator[polars.DataFrame]:
    """Yield the wanted columns, some ten thousand rows at a time; unreadable rows are noted in `damage`."""
    if table_format is LogFormat.parquet:
        table = _selected(polars.scan_parquet(path), wanted, path, place)
        n_rows = 0
        try:
            for frame in _collected(table):
                n_rows += len(frame)
                yield frame
        except READING_FAULTS:
            end = polars.scan_parquet(path).select(polars.len()).collect().item()
            lost: list[tuple[int, int, str]] = []
            yield from _readable_slices(table, n_rows, end, lost)
            damage += [
                f"rows {first} to {last} cannot be read ({reason}); they are lost"
                for first, last, reason in lost
            ]
        return
    with tempfile.TemporaryDirectory() as folder:
        end = _end_of_text(path)
        if end is not None:
            damage.append(f"byte {end}: no text stands here; the rows before it were read")
            path = _copy_front(path, end, Path(folder))
        # All columns as text: a stray word in a column then costs its row, not the file.
        text = polars.scan_csv(path, infer_schema=False, truncate_ragged_lines=True, encoding="utf8-lossy")
        yield from _collected(_selected(text, wanted, path, place))


def _selected(table: polars.LazyFrame, wanted: tuple[str, ...], path: Path, place: str) -> polars.LazyFrame:
    seen = table.collect_schema().names()
    missing = [name for name in dict.fromkeys(wanted) if name not in seen]
    if missing:
        listed = ", ".join(name[:LISTED_CHARACTERS] for name in seen[:LISTED_COLUMNS])
        more = f" and {len(seen) - LISTED_COLUMNS} more" if len(seen) > LISTED_COLUMNS else ""
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; map it in {place}, or move the table away if it is no "
            f"log; columns seen: {listed}{more}"
        )
    return table.select(list(dict.fromkeys(wanted)))


def _collected(table: polars.LazyFrame) -> Iterator[polars.DataFrame]:
    yield from table.collect_batches(chunk_size=SECTION_ROWS, maintain_order=True, lazy=True)


def _readable_slices(
    table: polars.LazyFrame, begin: int, end: int, lost: list[tuple[int, int, str]]
) -> Iterator[polars.DataFrame]:
    """Yield the readable part of some rows, by bisection down to `SMALLEST_SLICE`."""
    try:
        if end - begin > SECTION_ROWS:
            raise ValueError("too much at a time")
        yield table.slice(begin, end - begin).collect()
    except READING_FAULTS as error:
        if end - begin <= SMALLEST_SLICE:
            joins = bool(lost) and lost[-1][1] == begin - 1
            first, _, reason = lost.pop() if joins else (begin, 0, str(error).splitlines()[0])
            lost.append((first, end - 1, reason))
            return
        middle = (begin + end) // 2
        yield from _readable_slices(table, begin, middle, lost)
        yield from _readable_slices(table, middle, end, lost)


def _end_of_text(path: Path) -> int | None:
    """Return where readable text ends: at a zero byte or an unterminated line; None if the file is sound."""
    position = 0
    with path.open("rb") as file:
        while piece := file.read(PIECE_BYTES):
            if (zero := piece.find(b"\0")) >= 0:
                return position + zero
            if len(piece) == PIECE_BYTES and b"\n" not in piece:
                return position
            position += len(piece)
    return None


def _copy_front(path: Path, end: int, folder: Path) -> Path:
    """Copy the bytes before an offset."""
    copy = folder / path.name
    with path.open("rb") as source, copy.open("wb") as target:
        while end > 0 and (piece := source.read(min(PIECE_BYTES, end))):
            target.write(piece)
            end -= len(piece)
    return copy


def _numbers(frame: polars.DataFrame, names: list[str]) -> np.ndarray:
    """Return columns as numbers, NaN for other cells, shape (n_rows, len(names))."""
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
    # Whole units and fractions apart: seconds since 1970 with nanoseconds exceed float64's precision.
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
