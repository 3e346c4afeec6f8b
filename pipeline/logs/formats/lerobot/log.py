"""Read one episode of a LeRobot dataset into a `RawLog`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import InputError, first_line
from pipeline.logs.formats.discover import LogEntry
from pipeline.logs.formats.lerobot.dataset import (
    EPISODE,
    READING_FAULTS,
    DatasetInformation,
    read_information,
)
from pipeline.logs.formats.lerobot.features import Element, element_of
from pipeline.logs.messages.columns import SECTION_ROWS, ColumnStore
from pipeline.logs.messages.conversion import command_conversion, position_conversion
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.raw_log import (
    NANOSECONDS,
    Note,
    NoteKind,
    RawLog,
    first_damage,
    timed_by_one_clock,
)
from pipeline.machine.specification import MachineSpecification, per_joint

SAMPLES, COMMANDS = "samples", "commands"  # tables of the store
STAMP = "stamp"  # a feature of what this project writes: ns since 1970
TIMES = ("timestamp", "frame_index", "index")
SYNCHRONOUS_S = 1e-4  # LeRobot's own tolerance between time stamps and frame numbers


def read_lerobot(entry: LogEntry, machine: MachineSpecification, store: ColumnStore) -> RawLog:
    """Read the features that the machine's section `lerobot` names.

    Frames are timed by their number and the dataset's rate, counted over all episodes, or by the feature `stamp`.

    Raises:
        InputError: The file cannot be read, or lacks a feature.
    """
    information = read_information(entry.path)
    place = f"conf/machine/{machine.name}.yaml: lerobot"
    roles = {
        SAMPLES: (machine.lerobot.positions, "positions", position_conversion(machine)),
        COMMANDS: (machine.lerobot.commands, "commands", command_conversion(machine)),
    }
    elements = {
        table: [
            element_of(path, information.features, f"{place}.{key}")
            for path in per_joint(paths, machine.joint_names, f"{place}.{key}")
        ]
        for table, (paths, key, _) in roles.items()
    }
    path = entry.files[0]
    notes: list[Note] = []
    n_rows = n_untimed = 0
    for batch in _batches(path, entry.part, elements, notes):
        n_rows += len(batch)
        time_ns, has_time = _times_ns(batch, information)
        n_untimed += int((~has_time).sum())
        for table, (_, _, conversion) in roles.items():
            try:
                numbers = np.stack([element.values(batch) for element in elements[table]], axis=1)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
            values = conversion(numbers)
            chosen = has_time & ~np.isnan(values).all(axis=1)
            store.append(table, {"time_ns": time_ns[chosen], "value": values[chosen]})
    if entry.message_count is not None and n_rows != entry.message_count:
        lost = entry.message_count - n_rows
        text = (
            f"{path.name}: {n_rows} frames of episode {entry.part}; the dataset states {entry.message_count}"
        )
        notes.append(Note(NoteKind.damage, text, max(lost, 1)))
    if n_untimed:
        notes.append(
            Note(NoteKind.left_out, f"{path.name}: {n_untimed} frames left out: they hold no time", n_untimed)
        )
    sampled, commanded = store.columns(SAMPLES), store.columns(COMMANDS)
    for what, found in (("positions", sampled), ("commands", commanded)):
        if not found or not len(found["time_ns"]):
            raise InputError(
                f"{path}: no frame of episode {entry.part} holds a time and {what}{first_damage(notes)}"
            )
    return timed_by_one_clock(entry.name, entry.path, sampled, commanded, {path.name: n_rows}, notes, {})


def _batches(
    path: Path, episode: int | None, elements: dict[str, list[Element]], notes: list[Note]
) -> Iterator[pa.RecordBatch]:
    """Yield the frames of an episode; row groups that cannot be read on are noted."""
    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
    except READING_FAULTS as error:
        raise InputError(f"{path}: not a readable table ({first_line(error)}); restore it") from error
    with file:
        seen = file.schema_arrow.names
        wanted = {element.feature for found in elements.values() for element in found}
        if missing := sorted({EPISODE, *wanted} - set(seen)):
            raise InputError(
                f"{path}: column {', '.join(missing)} is missing; columns seen: {', '.join(seen[:24])}"
            )
        columns = [name for name in dict.fromkeys((EPISODE, *TIMES, STAMP, *sorted(wanted))) if name in seen]
        number_of_episode = seen.index(EPISODE)
        for group in range(file.num_row_groups):
            if not _may_hold(file, group, number_of_episode, episode):
                continue
            try:
                for batch in file.iter_batches(SECTION_ROWS, row_groups=[group], columns=columns):
                    is_wanted = batch.column(batch.schema.get_field_index(EPISODE)).to_numpy(
                        zero_copy_only=False
                    )
                    yield batch.filter(pa.array(is_wanted == episode))
            except READING_FAULTS as error:
                text = f"{path.name}: row group {group} cannot be read on ({first_line(error)})"
                notes.append(Note(NoteKind.damage, text))


def _may_hold(file: pq.ParquetFile, group: int, column: int, episode: int | None) -> bool:
    """Whether a row group may hold frames of an episode, by its statistics."""
    try:
        leaf = next(i for i in range(file.metadata.num_columns) if file.schema.column(i).path == EPISODE)
        statistics = file.metadata.row_group(group).column(leaf).statistics
        if statistics is None or not statistics.has_min_max or episode is None:
            return True
        return bool(statistics.min <= episode <= statistics.max)
    except (StopIteration, *READING_FAULTS, TypeError):
        return True


def _times_ns(batch: pa.RecordBatch, information: DatasetInformation) -> tuple[np.ndarray, np.ndarray]:
    """Return times in ns, shape (n,), int64, and which frames have one."""
    columns = {
        name: Element(name, 0).values(batch) if name in batch.schema.names else np.full(len(batch), np.nan)
        for name in TIMES
    }
    timestamp, frame, index = (columns[name] for name in TIMES)
    by_number = frame / information.fps
    elapsed = np.where(np.abs(timestamp - by_number) < SYNCHRONOUS_S, by_number, timestamp)
    begin = np.nan_to_num((index - frame) / information.fps)
    seconds = begin + elapsed
    is_known = np.isfinite(seconds) & (np.abs(seconds) < MAXIMUM_TIME_NS / NANOSECONDS)
    time_ns = np.rint(np.where(is_known, seconds, 0.0) * NANOSECONDS).astype(np.int64)
    if STAMP in batch.schema.names and pa.types.is_int64(batch.schema.field(STAMP).type):
        stamps = batch.column(batch.schema.get_field_index(STAMP))
        has_stamp = stamps.is_valid().to_numpy(zero_copy_only=False)
        exact = stamps.fill_null(0).to_numpy(zero_copy_only=False)
        is_possible = has_stamp & (np.abs(exact) < MAXIMUM_TIME_NS)
        return np.where(is_possible, exact, time_ns), is_possible | (~has_stamp & is_known)
    return time_ns, is_known
