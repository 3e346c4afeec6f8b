"""Find the episodes of a LeRobot dataset, each a log, and hold what the dataset states against them."""

from dataclasses import replace
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat, broken
from pipeline.logs.formats.lerobot.dataset import (
    INFORMATION,
    TOTALS,
    EpisodeFrames,
    data_files,
    episodes_of,
    is_dataset,
    read_information,
    stated_lengths,
)
from pipeline.logs.messages.raw_log import Note, NoteKind


def dataset_of(directory: Path) -> tuple[list[LogEntry], set[Path]]:
    """Return the episodes of the dataset in a folder, if it is one, and the tables that belong to it."""
    if not is_dataset(directory):
        return [], set()
    files = data_files(directory)
    own = {*files, *(directory / INFORMATION.parent).rglob("*.parquet")}
    try:
        information = read_information(directory)
    except InputError as error:
        return [broken(directory, str(error))], own
    entries: list[LogEntry] = []
    failed: list[LogEntry] = []
    found: dict[int, EpisodeFrames] = {}
    stated = stated_lengths(directory)
    for path in files:
        try:
            episodes = episodes_of(path)
        except InputError as error:
            failed.append(broken(path, str(error)))
            continue
        found |= episodes
        for number, frames in episodes.items():
            name, of = f"{directory.name}_episode_{number:06d}", (path, directory / INFORMATION)
            rows, length = (frames.begin, frames.end), stated.get(number)
            entries.append(LogEntry(name, directory, LogFormat.lerobot, of, (), length, number, rows))
    if not entries:
        return failed or [
            broken(directory, f"{directory}: a LeRobot dataset without frames; restore data/")
        ], own
    notes = _differences(directory.name, information.totals, stated, found)
    return [replace(entries[0], notes=tuple(notes)), *entries[1:], *failed], own


def _differences(
    name: str, totals: dict[str, int], stated: dict[int, int], found: dict[int, EpisodeFrames]
) -> list[Note]:
    """What is stated and not there. Frames that the list of episodes states are compared when an episode is read."""
    notes = []
    if missing := stated.keys() - found.keys():
        text = f"{name}: {len(missing)} of the episodes that the dataset states are in none of its files"
        notes.append(Note(NoteKind.damage, text, len(missing)))
    lengths = {number: frames.count for number, frames in found.items()} | stated
    for key, listed, n_found in zip(
        TOTALS,
        (len(lengths), sum(lengths.values())),
        (len(found), sum(frames.count for frames in found.values())),
        strict=True,
    ):
        if totals.get(key, listed) != listed:
            text = f"{name}: {INFORMATION} states {key} {totals[key]}, and {n_found} were found"
            notes.append(Note(NoteKind.damage, text, abs(totals[key] - n_found) or 1))
    return notes
