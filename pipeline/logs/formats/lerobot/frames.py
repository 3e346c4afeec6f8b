"""Read the frames of an episode. A file holds many: the row group that was read last is kept for the next one."""

import functools
from collections.abc import Collection, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import InputError, first_line
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.formats.lerobot.dataset import EPISODE, READING_FAULTS, episode_numbers
from pipeline.logs.messages.columns import SECTION_ROWS
from pipeline.logs.messages.raw_log import Note, NoteKind

KEPT_BYTES = 1 << 27  # of the wanted columns; LeRobot's files have 100 MB


def episode_frames(
    entry: LogEntry, needed: Collection[str], optional: Collection[str], notes: list[Note]
) -> Iterator[pa.RecordBatch]:
    """Yield an episode's frames with the needed columns and the optional ones that there are.

    Row groups that cannot be read on are noted.

    Raises:
        InputError: The file cannot be read, or lacks a needed column.
    """
    path = entry.files[0]
    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        status = path.stat()
    except READING_FAULTS as error:
        raise InputError(f"{path}: not a readable table ({first_line(error)}); restore it") from error
    with file:
        seen, row = file.schema_arrow.names, 0
        if missing := sorted({EPISODE, *needed} - set(seen)):
            raise InputError(
                f"{path}: column {', '.join(missing)} is missing; columns seen: {', '.join(seen[:24])}"
            )
        columns = tuple(name for name in dict.fromkeys((EPISODE, *needed, *optional)) if name in seen)
        begin, end = entry.rows or (0, file.metadata.num_rows)
        for group in range(file.num_row_groups):
            n_rows = file.metadata.row_group(group).num_rows
            if row < end and row + n_rows > begin:
                kept = _kept(path, (status.st_size, status.st_mtime_ns), group, columns)
                try:
                    batches, fault = (_batches(file, group, columns), None) if kept is None else kept
                    yield from _of_episode(batches, entry.part, begin - row, end - row)
                except READING_FAULTS as error:
                    fault = first_line(error)
                if fault:
                    text = f"{path.name}: row group {group} cannot be read on ({fault})"
                    notes.append(Note(NoteKind.damage, text))
            row += n_rows


@functools.lru_cache(maxsize=1)
def _kept(
    path: Path, _of_version: tuple[int, int], group: int, columns: tuple[str, ...]
) -> tuple[list[pa.RecordBatch], str] | None:
    """The batches of a row group, and why they are not all; None if they take too much memory."""
    batches: list[pa.RecordBatch] = []
    n_bytes = 0
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            for batch in _batches(file, group, columns):
                n_bytes += batch.nbytes
                if n_bytes > KEPT_BYTES:
                    return None
                batches.append(batch)
    except READING_FAULTS as error:
        return batches, first_line(error)
    return batches, ""


def _batches(file: pq.ParquetFile, group: int, columns: tuple[str, ...]) -> Iterator[pa.RecordBatch]:
    yield from file.iter_batches(SECTION_ROWS, row_groups=[group], columns=list(columns))


def _of_episode(
    batches: Collection[pa.RecordBatch] | Iterator[pa.RecordBatch], episode: int | None, begin: int, end: int
) -> Iterator[pa.RecordBatch]:
    """Yield the frames of an episode between two rows of a row group."""
    row = 0
    for batch in batches:
        first = max(begin - row, 0)
        own = batch.slice(first, max(end - row - first, 0))  # up to the batch's end at most
        row += len(batch)
        if row > begin:
            is_wanted = episode_numbers(own.column(own.schema.get_field_index(EPISODE))) == episode
            yield own.filter(pa.array(is_wanted))
        if row >= end:
            return
