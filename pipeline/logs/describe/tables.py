"""Add what a CSV or Parquet table holds to the contents of a folder."""

import re

import numpy as np
import polars

from pipeline.errors import InputError, counted, first_line
from pipeline.logs.describe.contents import Contents, Stream
from pipeline.logs.describe.field_types import TEXT, TIME
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat
from pipeline.logs.formats.tables import READING_FAULTS, refuse_separator

TABLE = "table"  # type of the stream, and first word of its key
TIME_NAME = re.compile(
    r"(^|[^a-z])(t|time|stamp|timestamp|sec|seconds|nsec|ns|ms|us)([^a-z]|$)", re.IGNORECASE
)
MAXIMUM_ROWS = 1_000_000  # more are not looked at
SECONDS_PER = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def add_table(entry: LogEntry, contents: Contents) -> None:
    """Add the columns of a table and their ranges.

    Raises:
        InputError: The table cannot be read.
    """
    path = entry.files[0]
    try:
        lazy = (
            polars.scan_parquet(path)
            if entry.format is LogFormat.parquet
            else polars.scan_csv(
                path,
                infer_schema_length=None,
                truncate_ragged_lines=True,
                ignore_errors=True,
                encoding="utf8-lossy",
            )
        )
        frame = lazy.head(MAXIMUM_ROWS).collect()
    except READING_FAULTS as error:
        raise InputError(f"{path}: not a readable table ({first_line(error)})") from error
    refuse_separator(frame.columns, path)
    if not all(name.isprintable() for name in frame.columns):
        raise InputError(
            f"{path}: its first line does not name columns; save the table as UTF-8 with a first line"
        )
    stream = contents.stream((TABLE, *frame.columns), path.name, TABLE)
    for name, column in zip(frame.columns, frame.iter_columns(), strict=True):
        dtype = column.dtype
        kind = TIME if dtype.is_temporal() else TEXT if dtype == polars.String else str(dtype)
        stream.add_fields({name: kind})
        if dtype.is_numeric():
            values = column.cast(polars.Float64).fill_null(float("nan")).to_numpy()
            stream.fields[name].add_numbers(values[:, None])
    stream.add_times(_times_ns(frame, stream))
    stream.n_of_log = len(frame)  # also those without a time
    stream.end_log()
    only = "the first " if len(frame) == MAXIMUM_ROWS else ""
    contents.add_log(f"{entry.path}: {only}{counted(len(frame), 'row')}", entry.notes)


def _times_ns(frame: polars.DataFrame, stream: Stream) -> np.ndarray:
    name = time_column(stream)
    if name is not None and frame[name].dtype in (polars.Datetime, polars.Duration):
        stream.fields[name].unit = "ns"
        return frame[name].drop_nulls().dt.cast_time_unit("ns").cast(polars.Int64).to_numpy()
    if name is None or not frame[name].dtype.is_numeric():
        return np.zeros(0, np.int64)
    seconds = frame[name].cast(polars.Float64).drop_nulls().to_numpy()
    unit = time_unit(seconds)
    stream.fields[name].unit = unit
    whole = np.isfinite(seconds) & (np.abs(seconds) < 2.0**62 / 1e9 / SECONDS_PER[unit])
    return (seconds[whole] * (SECONDS_PER[unit] * 1e9)).astype(np.int64)


def time_column(stream: Stream) -> str | None:
    """The column that is probably the time: the first one named so, or the first one of a time type."""
    named = [name for name in stream.fields if TIME_NAME.search(name)]
    typed = [name for name, content in stream.fields.items() if content.type_name == TIME]
    return next(iter([*named, *typed]), None)


def time_unit(times: np.ndarray) -> str:
    """The unit by which the interval between times is from 1 ms to 1 s, as machines are sampled; s if it is shorter."""
    steps = np.diff(np.sort(times))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    return next((unit for unit, seconds in SECONDS_PER.items() if step * seconds < 1), "ns")
