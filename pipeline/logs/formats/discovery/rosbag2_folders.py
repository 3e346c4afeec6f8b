"""The ROS 2 bag among a folder's files, as its `metadata.yaml` lists them, or as the names of the files tell."""

import re
from pathlib import Path

from pipeline.logs.formats.compression.compressed_file import COMPRESSED_SUFFIXES
from pipeline.logs.formats.discovery.duplicates import original
from pipeline.logs.formats.discovery.log_entry import (
    FORMATS,
    LogEntry,
    broken,
    could_be_log,
    format_of,
    is_regular_file,
    uncompressed,
)
from pipeline.logs.formats.discovery.rosbag2_metadata import METADATA, BagMetadata, read_metadata
from pipeline.logs.formats.opened_file import why_unreadable
from pipeline.logs.messages.raw_log import Note, NoteKind

BAG_SUFFIXES = (".mcap", ".db3")
COMPRESSION_FORMATS = ("", "zstd")
SPLIT_NAME = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


def bag_of(directory: Path, files: list[Path]) -> tuple[list[LogEntry], set[Path]]:
    """Return the ROS 2 bag among a folder's own files, if there is one, and the files that it accounts for."""
    found = [path for path in files if uncompressed(path).suffix in BAG_SUFFIXES and original(path) == path]
    parts = sorted(filter(is_regular_file, found), key=_part_number)
    place = directory / METADATA
    if place not in files:
        return _split_bag(directory, parts)
    try:
        if (reason := why_unreadable(place)) is not None:
            return [broken(directory, reason)], set(parts)
        metadata = read_metadata(place)
    except OSError as error:
        text = f"{place}: cannot be read ({error.strerror}); check its permissions"
        return [broken(directory, text)], set(parts)
    if metadata is None or (
        not metadata.files and not _are_of_one_bag(parts) and any(map(could_be_log, files))
    ):
        return _split_bag(directory, parts)
    return _described_bag(directory, metadata, parts)


def _split_bag(directory: Path, parts: list[Path]) -> tuple[list[LogEntry], set[Path]]:
    """The bag of files NAME_0, NAME_1, … in a folder NAME without metadata."""
    for suffix in BAG_SUFFIXES:
        own = [
            path
            for path in parts
            if uncompressed(path).suffix == suffix
            and _bag_name(path) == directory.name != uncompressed(path).stem
        ]
        if own:
            return [LogEntry(directory.name, directory, FORMATS[suffix], tuple(own))], set(own)
    return [], set()


def _described_bag(
    directory: Path, metadata: BagMetadata, parts: list[Path]
) -> tuple[list[LogEntry], set[Path]]:
    """The bag of the files that the metadata lists, or of those that must be meant if it is damaged or they are not."""
    # Older releases list files with their folder.
    listed = [*dict.fromkeys(_existing_variant(directory / Path(name).name) for name in metadata.files)]
    present = [path for path in listed if is_regular_file(path)]
    if not present and (_are_of_one_bag(parts) or len(parts) == len(listed)):
        present = parts
    taken = {*listed, *present}
    place, names = directory / METADATA, ", ".join(metadata.files) or "none"
    formats = {kind for path in present if (kind := format_of(path)) is not None}
    if metadata.compression not in COMPRESSION_FORMATS:
        reason = (
            f"{place}: the bag is compressed as {metadata.compression}, which is not read; convert it with "
            "`ros2 bag convert`"
        )
    elif not present:
        reason = f"{directory}: a bag folder without its files; {METADATA} lists {names}"
    elif len(formats) != 1:
        reason = f"{place}: lists files that are neither .mcap nor .db3: {names}"
    else:
        reason = ""
    if reason:
        return [broken(directory, reason)], taken
    notes = [
        Note(NoteKind.damage, f"{directory.name}: file {path.name} is listed in {METADATA} and missing")
        for path in listed
        if path not in present
    ]
    if not listed:
        text = f"{directory.name}: {METADATA} is damaged; all files named like these are taken as the bag"
        notes = [Note(NoteKind.attention, text)]
    (kind,) = formats
    entry = LogEntry(directory.name, directory, kind, tuple(present), tuple(notes), metadata.message_count)
    return [entry], taken


def _are_of_one_bag(parts: list[Path]) -> bool:
    return len({(_bag_name(path), uncompressed(path).suffix) for path in parts}) == 1


def _bag_name(path: Path) -> str:
    """Return the name of the bag of which a file is a part, by the file's name."""
    match = SPLIT_NAME.fullmatch(uncompressed(path).stem)
    return match["stem"] if match else uncompressed(path).stem


def _existing_variant(path: Path) -> Path:
    """Return the existing variant of a listed file, which may have been compressed or decompressed since."""
    plain = uncompressed(path)
    others = [plain, *(plain.with_name(plain.name + suffix) for suffix in COMPRESSED_SUFFIXES)]
    return next((other for other in [path, *others] if is_regular_file(other)), path)


def _part_number(path: Path) -> tuple[int, str]:
    match = SPLIT_NAME.fullmatch(uncompressed(path).stem)
    return (int(match["number"]) if match else 0, path.name)
