"""Read one episode of a LeRobot dataset into a `RawLog`."""

import numpy as np
import pyarrow as pa

from pipeline.errors import InputError
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.formats.lerobot.dataset import DatasetInformation, read_information
from pipeline.logs.formats.lerobot.features import Element, NoNumbersError, element_of
from pipeline.logs.formats.lerobot.frames import episode_frames
from pipeline.logs.messages.columns import ColumnStore
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.one_clock import COMMANDS, POSITIONS, OneClockLog, channel_stream
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog, first_damage
from pipeline.machine.log_sources import per_joint
from pipeline.machine.specification import MachineSpecification

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
    elements = {
        stream: [
            element_of(path, information.features, f"{place}.{stream}")
            for path in per_joint(getattr(machine.lerobot, stream), machine.joint_names, f"{place}.{stream}")
        ]
        for stream in (POSITIONS, COMMANDS)
    }
    path = entry.files[0]
    notes: list[Note] = []
    needed = {element.feature for found in elements.values() for element in found}
    channels = _channels(machine, information, notes)
    optional = (*TIMES, STAMP, *(element.feature for (element,) in channels.values()))
    log = OneClockLog(machine, store)
    n_rows, n_untimed, other_stamp = 0, 0, ""
    try:
        for batch in episode_frames(entry, sorted(needed), optional, notes):
            n_rows += len(batch)
            if STAMP in batch.schema.names and not pa.types.is_int64(kind := batch.schema.field(STAMP).type):
                other_stamp = (
                    f"feature {STAMP} holds {kind}, not int64 in ns; frames are timed by their number"
                )
            time_ns, has_time = _times_ns(batch, information)
            n_untimed += int((~has_time).sum())
            for stream, own in (elements | channels).items():
                if any(element.feature not in batch.schema.names for element in own):
                    continue
                try:
                    log.add(stream, time_ns, np.stack([e.values(batch) for e in own], axis=1), has_time)
                except NoNumbersError as error:
                    if stream in elements:
                        raise
                    del channels[stream]
                    notes.append(Note(NoteKind.left_out, f"{path.name}: {stream}: {error}"))
    except NoNumbersError as error:
        raise InputError(f"{path}: {error}") from error
    if entry.message_count is not None and n_rows != entry.message_count:
        lost = entry.message_count - n_rows
        text = (
            f"{path.name}: {n_rows} frames of episode {entry.part}; the dataset states {entry.message_count}"
        )
        notes.append(Note(NoteKind.damage, text, max(lost, 1)))
    if other_stamp:
        notes.append(Note(NoteKind.attention, f"{path.name}: {other_stamp}", n_rows))
    if n_untimed:
        notes.append(
            Note(NoteKind.left_out, f"{path.name}: {n_untimed} frames left out: they hold no time", n_untimed)
        )
    return log.finish(
        entry.name,
        entry.path,
        {path.name: n_rows},
        notes,
        lambda what: f"{path}: no frame of episode {entry.part} holds a time and {what}{first_damage(notes)}",
    )


def _channels(
    machine: MachineSpecification, information: DatasetInformation, notes: list[Note]
) -> dict[str, list[Element]]:
    """The machine's channels that the dataset has, by stream; the others that name a column are noted."""
    found = {}
    for channel in machine.channels:
        if channel.column:
            try:
                element = element_of(channel.column, information.features, f"channel {channel.name}")
                found[channel_stream(channel.name)] = [element]
            except InputError as error:
                notes.append(Note(NoteKind.attention, str(error)))
    return found


def _times_ns(batch: pa.RecordBatch, information: DatasetInformation) -> tuple[np.ndarray, np.ndarray]:
    """Return times in ns, shape (n,), int64, and which frames have one."""
    columns = {
        name: Element(name, 0).values(batch) if name in batch.schema.names else np.full(len(batch), np.nan)
        for name in TIMES
    }
    timestamp, frame, index = (columns[name] for name in TIMES)
    by_number = frame / information.fps
    elapsed = np.where(np.abs(timestamp - by_number) < SYNCHRONOUS_S, by_number, timestamp)
    begins = (index - frame) / information.fps  # the same for all frames of an episode
    is_begin = np.isfinite(begins)
    begin = np.where(is_begin, begins, np.median(begins[is_begin]) if is_begin.any() else 0.0)
    seconds = begin + elapsed
    is_known = np.isfinite(seconds) & (np.abs(seconds) < MAXIMUM_TIME_NS / NANOSECONDS)
    time_ns = np.rint(np.where(is_known, seconds, 0.0) * NANOSECONDS).astype(np.int64)
    if STAMP in batch.schema.names and pa.types.is_int64(batch.schema.field(STAMP).type):
        stamps = batch.column(batch.schema.get_field_index(STAMP))
        has_stamp = stamps.is_valid().to_numpy(zero_copy_only=False)
        exact = stamps.fill_null(0).to_numpy(zero_copy_only=False)
        is_possible = has_stamp & (np.abs(exact) < MAXIMUM_TIME_NS)
        return np.where(is_possible, exact, 0), is_possible  # no other clock stands in for a missing stamp
    return time_ns, is_known
