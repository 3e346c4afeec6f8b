"""Read CSV and Parquet logs with the machine's column map."""

import itertools
import re
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars

from pipeline.errors import InputError, first_line
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat
from pipeline.logs.messages.columns import SECTION_ROWS, ColumnStore
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.one_clock import COMMANDS, POSITIONS, OneClockLog, channel_stream
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog, first_loss
from pipeline.machine.specification import MachineSpecification

NANOSECONDS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
NANOSECONDS_PER_DAY = 86_400 * NANOSECONDS_PER["s"]
# Polars' Parquet reader panics at some damage, which is no `Exception`.
READING_FAULTS = (polars.exceptions.PolarsError, polars.exceptions.PanicException, OSError, ValueError)
PIECE_BYTES = 1 << 22  # longer than any line of a table
LISTED_COLUMNS, LISTED_CHARACTERS = 24, 40
BEYOND = "…beyond"  # holds what stands behind the last column of a CSV file's header
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}  # that are not read
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
DECIMAL_COMMA = r"[+-]?\d+,\d+"
MISSING = ("", "na", "n/a", "nan", "null", "none", "-")  # words that other programs write into empty cells


@dataclass
class _Cells:
    """The cells of a table's columns, and those that hold no number.

    Attributes:
        n_strange: Cells with anything else than a number, by column; infinite numbers of channels, too.
        first: The first of them: its row, counted from one, and its content.
        n_missing: Empty cells, by column.
    """

    n_strange: dict[str, int] = field(default_factory=dict)
    first: dict[str, tuple[int, str]] = field(default_factory=dict)
    n_missing: dict[str, int] = field(default_factory=dict)

    def numbers(
        self, frame: polars.DataFrame, names: list[str], rows: np.ndarray, finite: bool = False
    ) -> np.ndarray:
        """Return columns as numbers, NaN for other cells, shape (n_rows, len(names)).

        Args:
            frame: Some rows of the table.
            names: Of the columns.
            rows: Their rows in the file, counted from one.
            finite: Whether numbers that are not finite are strange too.
        """
        parts, nothing = [], polars.repeat(None, len(frame), dtype=polars.Float64, eager=True)
        for name in names:
            column, text = frame[name], _stripped(frame[name])
            number = text.cast(polars.Float64, strict=False) if _may_hold_numbers(column.dtype) else nothing
            is_missing = text.is_null()
            if column.dtype == polars.String and number.null_count() > is_missing.sum():
                is_missing |= number.is_null() & text.str.to_lowercase().is_in(MISSING)
            value = number.fill_null(float("nan")).to_numpy()
            is_strange = ~is_missing.to_numpy() & (
                ~np.isfinite(value) if finite else number.is_null().to_numpy()
            )
            value = np.where(is_strange, np.nan, value)
            self.n_missing[name] = self.n_missing.get(name, 0) + int(is_missing.sum())
            self.n_strange[name] = self.n_strange.get(name, 0) + int(is_strange.sum())
            if is_strange.any() and name not in self.first:
                place = int(is_strange.argmax())
                self.first[name] = (
                    int(rows[place]),
                    str(column[place : place + 1].to_list()[0])[:LISTED_CHARACTERS],
                )
            parts.append(value)
        return np.stack(parts, axis=1)

    def notes(self, file_name: str, channels: Collection[str]) -> Iterator[Note]:
        """What is told of them; empty cells of positions and commands are usual and told by the rules for both."""
        for name, (row, cell) in self.first.items():
            of_channel, n = ("the channel's " if name in channels else ""), self.n_strange[name]
            is_comma = re.fullmatch(DECIMAL_COMMA, cell.strip())
            remedy = "write numbers " + ("with a decimal point" if is_comma else "or map another column")
            what = f"cells of {of_channel}column {name} are not numbers: {n}, first `{cell}` in row {row}"
            yield Note(NoteKind.left_out, f"{file_name}: {what}; {remedy}", n)
        for name in channels:
            if n := self.n_missing.get(name, 0):
                text = f"{file_name}: cells of the channel's column {name} are empty: {n}"
                yield Note(NoteKind.left_out, text, n, is_usual=True)


def read_table(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
    """Read one table: a row per sample, with the columns that the machine's `columns` names.

    A row may lack the positions or the commands (streams of different rates in one table); it is then a sample of the
    other stream alone. Rows without time, or with neither, are counted and dropped, as are rows of a CSV file with more
    values than columns. A time column of a temporal type has its own unit.

    Raises:
        InputError: The file cannot be read, or a column is missing or holds no numbers.
    """
    columns, place = machine.columns, f"conf/machine/{machine.name}.yaml: columns"
    if columns.time_unit not in NANOSECONDS_PER:
        raise InputError(
            f"{place}.time_unit is `{columns.time_unit}`; use one of {', '.join(NANOSECONDS_PER)}"
        )
    patterns = {POSITIONS: columns.position, COMMANDS: columns.command}
    of_joints = {
        stream: [pattern.replace("{joint}", joint) for joint in machine.joint_names]
        for stream, pattern in patterns.items()
    }
    channels = {channel.name: channel.column for channel in machine.channels if channel.column}
    streams = of_joints | {channel_stream(name): [column] for name, column in channels.items()}
    log, path = OneClockLog(machine, store), entry.files[0]
    n_rows = n_unused = n_timed = n_long = 0
    example = ""  # of a time that is not understood
    damage: list[str] = []
    cells = _Cells()
    try:
        wanted = (columns.time, *itertools.chain(*of_joints.values()))
        for frame in _batches(path, entry.format, wanted, place, damage, tuple(channels.values())):
            rows = n_rows + 1 + np.arange(len(frame))
            n_rows += len(frame)
            if BEYOND in frame.columns and (is_long := frame[BEYOND].is_not_null()).any():
                n_long += int(is_long.sum())
                frame, rows = frame.filter(~is_long), rows[~is_long.to_numpy()]
            time_ns, has_time = _time_ns(frame[columns.time], NANOSECONDS_PER[columns.time_unit])
            used = np.zeros(len(frame), bool)
            for stream, names in streams.items():
                if names[0] in frame.columns:  # a channel's may be missing
                    numbers = cells.numbers(frame, names, rows, finite=stream not in of_joints)
                    used |= log.add(stream, time_ns, numbers, has_time)
            n_unused += int((~used).sum())
            n_timed += int(has_time.sum())
            example = example or _example(frame[columns.time].filter(~has_time))
    except READING_FAULTS as error:
        reason = first_line(error)
        if not n_rows:
            raise InputError(f"{path}: not a readable table ({reason}); repair or remove it") from error
        damage.append(f"the table is damaged after row {n_rows} ({reason}); the rows before it were read")
    unknown = ""
    if not n_timed and example:
        unknown = (
            f": column {columns.time} holds `{example}`, not a number of {columns.time_unit}; time_unit may be "
            f"{', '.join(NANOSECONDS_PER)}"
        )
    notes = [Note(NoteKind.damage, f"{path.name}: {text}") for text in damage]
    refusal = f"check the column map in {place}{unknown}" + first_loss(
        [*notes, *cells.notes(path.name, channels.values())]
    )
    for n, held in (
        (n_long, "more values than the table has columns"),
        (n_unused, "no time, or neither positions nor commands"),
    ):
        if n:
            notes.append(Note(NoteKind.left_out, f"{path.name}: {n} rows left out: they hold {held}", n))
    notes += cells.notes(path.name, channels.values())
    notes += [
        Note(NoteKind.attention, f"channel {name}: {path.name} has no column `{column}`")
        for name, column in channels.items()
        if column not in cells.n_missing
    ]
    return log.finish(
        entry.name,
        path,
        {path.name: n_rows},
        notes,
        lambda what: f"{path}: no row holds a time and {what}; {refusal}",
    )


def _batches(
    path: Path,
    table_format: LogFormat,
    wanted: tuple[str, ...],
    place: str,
    damage: list[str],
    optional: tuple[str, ...],
) -> Iterator[polars.DataFrame]:
    """Yield the wanted columns, and the optional ones that the table has, some ten thousand rows at a time.

    Unreadable rows are noted in `damage`.
    """
    if table_format is LogFormat.parquet:
        table = _selected(polars.scan_parquet(path), wanted, path, place, optional)
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
    if _is_utf16(path):
        raise InputError(f"{path}: is text in UTF-16; save it as UTF-8 (Excel: `CSV UTF-8`)")
    with tempfile.TemporaryDirectory() as folder:
        end, readable = _end_of_text(path), path
        if end is not None:
            damage.append(f"byte {end[0]}: {end[1]}; the rows before it were read")
            readable = _copy_front(path, end[0], Path(folder))
        yield from _collected(_selected(_scan_csv(readable), wanted, path, place, (*optional, BEYOND)))


def _scan_csv(path: Path) -> polars.LazyFrame:
    """Open a CSV file with all columns as text: a stray word in a column then costs its row, not the file."""
    names = polars.scan_csv(path, infer_schema=False, encoding="utf8-lossy").collect_schema().names()
    return polars.scan_csv(
        path,
        schema=dict.fromkeys([*names, BEYOND], polars.String),
        missing_columns="insert",
        truncate_ragged_lines=True,
        encoding="utf8-lossy",
    )


def _selected(
    table: polars.LazyFrame, wanted: tuple[str, ...], path: Path, place: str, optional: tuple[str, ...]
) -> polars.LazyFrame:
    schema = table.collect_schema()
    seen = [name for name in schema if name != BEYOND]
    missing = [name for name in dict.fromkeys(wanted) if name not in schema]
    if missing:
        refuse_separator(seen, path)
        listed = ", ".join(name[:LISTED_CHARACTERS] for name in seen[:LISTED_COLUMNS])
        more = f" and {len(seen) - LISTED_COLUMNS} more" if len(seen) > LISTED_COLUMNS else ""
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; map it in {place}, or move the table away if it is not "
            f"a log; columns seen: {listed}{more}"
        )
    there = [name for name in optional if name in schema]
    for number, name in enumerate(wanted):
        dtype = schema[name]
        if not (_may_hold_numbers(dtype) or (number == 0 and dtype.is_temporal())):
            raise InputError(
                f"{path}: column {name} holds {dtype}, not numbers; map another column in {place}"
            )
    return table.select(list(dict.fromkeys((*wanted, *there))))


def refuse_separator(names: list[str], path: Path) -> None:
    """Raise `InputError` if a CSV file's header shows that its columns are not separated by commas."""
    for mark, separators in SEPARATORS.items():
        if len(names) == 1 and mark in names[0]:
            raise InputError(
                f"{path}: its columns are separated by {separators}; save it with commas, and numbers with a point"
            )


def _may_hold_numbers(dtype: polars.DataType) -> bool:
    return dtype.is_numeric() or dtype in (polars.String, polars.Boolean, polars.Null)


def _collected(table: polars.LazyFrame) -> Iterator[polars.DataFrame]:
    yield from table.collect_batches(chunk_size=SECTION_ROWS, maintain_order=True, lazy=True)


def _readable_slices(
    table: polars.LazyFrame, begin: int, end: int, lost: list[tuple[int, int, str]]
) -> Iterator[polars.DataFrame]:
    """Yield the readable part of some rows."""

    def rows_or_fault(row: int, n_rows: int) -> polars.DataFrame | str:
        try:
            return table.slice(row, n_rows).collect()
        except READING_FAULTS as error:
            return first_line(error)

    while begin < end:
        n_rows = SECTION_ROWS
        while isinstance(found := rows_or_fault(begin, min(n_rows, end - begin)), str) and n_rows > 1:
            n_rows //= 2
        if not isinstance(found, str):
            yield found
            begin += len(found)
            continue
        # A damaged page hides all rows up to its end, which may be a million: it is looked for in growing steps.
        step = 1
        while begin + step < end and isinstance(rows_or_fault(begin + step, 1), str):
            step *= 2
        damaged, readable = begin + step // 2, min(begin + step, end)
        while readable - damaged > 1:
            middle = (damaged + readable) // 2
            if isinstance(rows_or_fault(middle, 1), str):
                damaged = middle
            else:
                readable = middle
        lost.append((begin, readable - 1, found))
        begin = readable


def _is_utf16(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(64)
    halves = sorted((head[0::2], head[1::2]))  # of Latin letters, one half is zero
    return head[:2] in UTF16_MARKS or (len(head) > 3 and not any(halves[0]) and all(halves[1]))


def _end_of_text(path: Path) -> tuple[int, str] | None:
    """Return where readable rows end and why: at a zero byte or a row that is cut off; None if all is sound."""
    position, header, last = 0, b"", b""
    with path.open("rb") as file:
        while piece := file.read(PIECE_BYTES):
            if (zero := piece.find(b"\0")) >= 0:
                return position + zero, "no text stands here"
            if len(piece) == PIECE_BYTES and b"\n" not in piece:
                return position, "no text stands here"
            header = header or piece.partition(b"\n")[0]
            last = (last + piece).rpartition(b"\n")[2]
            position += len(piece)
    if last and last.count(b",") < header.count(b",") and b'"' not in header:
        return position - len(last), "the file ends within this row"
    return None


def _copy_front(path: Path, end: int, folder: Path) -> Path:
    """Copy the bytes before an offset."""
    copy = folder / path.name
    with path.open("rb") as source, copy.open("wb") as target:
        while end > 0 and (piece := source.read(min(PIECE_BYTES, end))):
            target.write(piece)
            end -= len(piece)
    return copy


def _stripped(column: polars.Series) -> polars.Series:
    return column.str.strip_chars() if column.dtype == polars.String else column


def _time_ns(column: polars.Series, nanoseconds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times in ns and which rows have one.

    Args:
        column: Numbers, text, or a temporal type.
        nanoseconds: Unit of numbers and text.
    """
    if (dtype := column.dtype).is_temporal():
        nanoseconds = _unit_of(dtype)
        column = column.to_physical()
    text = _stripped(column)
    number = text.cast(polars.Float64, strict=False).fill_null(float("nan")).to_numpy()
    limit = MAXIMUM_TIME_NS // nanoseconds
    valid = np.isfinite(number) & (np.abs(number) < limit)
    # Whole units and fractions apart: seconds since 1970 with nanoseconds exceed float64's precision.
    units = np.floor(np.where(valid, number, 0.0))
    rest = np.where(valid, number, 0.0) - units
    time_ns = units.astype(np.int64) * nanoseconds + np.rint(rest * nanoseconds).astype(np.int64)
    if column.dtype not in (polars.Float64, polars.Float32):
        whole = text.cast(
            polars.Int64, strict=False
        )  # exact, where a float64 of nanoseconds since 1970 is not
        is_whole = whole.is_not_null().to_numpy()
        exact = whole.fill_null(0).clip(-limit, limit).to_numpy() * nanoseconds
        time_ns = np.where(is_whole, exact, time_ns)
    return time_ns, valid


def _unit_of(dtype: polars.DataType) -> int:
    """Nanoseconds per unit of a temporal type's numbers."""
    if isinstance(dtype, polars.Datetime | polars.Duration):
        return NANOSECONDS_PER[dtype.time_unit]
    return NANOSECONDS_PER_DAY if isinstance(dtype, polars.Date) else NANOSECONDS_PER["ns"]


def _example(cells: polars.Series) -> str:
    """The first cell that is not empty."""
    filled = cells.drop_nulls()
    return str(filled[0])[:LISTED_CHARACTERS] if len(filled) else ""
