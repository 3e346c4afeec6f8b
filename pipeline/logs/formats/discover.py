"""Find the logs in a folder: bags of every format and tables, mixed and in subfolders."""

import enum
import errno
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.formats.can import detect as can_logs
from pipeline.logs.formats.compressed_file import COMPRESSED_SUFFIXES
from pipeline.logs.formats.lerobot import dataset as lerobot
from pipeline.logs.formats.log_names import unique_names
from pipeline.logs.formats.opened_file import why_unreadable
from pipeline.logs.formats.rosbag2_metadata import METADATA, BagMetadata, read_metadata
from pipeline.logs.messages.raw_log import Note, NoteKind
from pipeline.logs.tuples import SUFFIX, is_tuple_file

SPLIT_NAME = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


class LogFormat(enum.StrEnum):
    """File formats, by their reader."""

    mcap = "mcap"
    rosbag1 = "rosbag1"
    sqlite3 = "sqlite3"
    csv = "csv"
    parquet = "parquet"
    can = "can"
    lerobot = "lerobot"


BAG_SUFFIXES = (".mcap", ".db3")  # of ROS 2
COMPRESSION_FORMATS = ("", "zstd")
UNREAD_SUFFIXES = (".gz", ".bz2", ".xz", ".lz4", ".zip", *COMPRESSED_SUFFIXES)
NOT_UTF8 = "{}: its name is not UTF-8; rename it"
KEPT_COPY = ".orig.bag"  # the original that `rosbag reindex`, `fix` and `compress` keep beside their result
FORMATS = {
    ".mcap": LogFormat.mcap,
    ".bag": LogFormat.rosbag1,
    ".active": LogFormat.rosbag1,  # left by a crashed `rosbag record`
    ".db3": LogFormat.sqlite3,
    ".csv": LogFormat.csv,
    ".parquet": LogFormat.parquet,
}


@dataclass(frozen=True)
class LogEntry:
    """One log: a file, or a bag folder whose files belong together.

    Attributes:
        name: Unique within the folder that was searched.
        path: The file or the bag folder.
        format: Format of its files.
        files: Its files in the order of recording.
        notes: What was found out before it is read, such as missing files.
        message_count: Number of messages that `metadata.yaml` states, if it does.
        part: Which episode of its files, where these hold several logs.
        error: Why it cannot be read, if already known; `read_log` raises it.
    """

    name: str
    path: Path
    format: LogFormat
    files: tuple[Path, ...]
    notes: tuple[Note, ...] = ()
    message_count: int | None = None
    part: int | None = None
    error: str = ""


def find_logs(directory: Path) -> list[LogEntry]:
    """Find all logs in a folder and its subfolders, ordered by path; a bag's own path is allowed too.

    The files that a ROS 2 bag's `metadata.yaml` lists are one bag; other files beside it are logs of their own. Split
    files of a folder without it (`NAME_0.mcap`, `NAME_1.mcap` in the folder NAME) are one bag too. Each may be
    compressed as a file (`NAME_0.mcap.zstd`). A log found twice, through a link or as a copy, is read once, and a note
    names the other. Names that begin with a dot and tuples of an earlier run are passed over.

    Raises:
        InputError: The folder does not exist, cannot be read, or holds no log.
    """
    if not directory.exists():
        raise InputError(f"{directory}: no such folder; name a folder of logs")
    if _printable(str(directory)) != str(directory):
        raise InputError(NOT_UTF8.format(directory))
    if not directory.is_dir():
        entries = [entry for entry in [_file_entry(directory)] if entry is not None]
    else:
        entries = _each_once(_entries(directory, set()), directory)
    if not entries:
        if directory.is_dir() and any(map(is_tuple_file, directory.rglob(f"*{SUFFIX}"))):
            raise InputError(
                f"{directory}: holds no logs but tuples in the output of ingest; name a folder of logs"
            )
        expected = (
            "ROS 1 .bag, ROS 2 folders or .db3, .mcap, these with .zstd, .csv, .parquet, CAN .blf, .asc, .log"
        )
        raise InputError(f"{directory}: holds no logs ({expected}); name a folder of logs")
    names = unique_names([(entry.name, entry.path) for entry in entries], directory)
    return [replace(entry, name=name) for entry, name in zip(entries, names, strict=True)]


def is_empty_folder(path: Path) -> bool:
    """Whether it is a folder with nothing in it."""
    return path.is_dir() and not any(path.iterdir())


def _entries(directory: Path, met: set[Path]) -> list[LogEntry]:
    """Find the logs of a folder; `met` holds the folders searched already, to which links may lead back."""
    met.add(directory.resolve())
    try:
        children = sorted(os.scandir(directory), key=lambda child: child.name)
    except OSError as error:
        text = f"{directory}: cannot be read ({error.strerror}); check the folder's permissions"
        return [_broken(directory, text)]
    if lerobot.is_dataset(directory):
        return _episodes(directory)
    visible = [child for child in children if child.name[0] != "."]
    folders = [directory / child.name for child in visible if _is_folder(child)]
    files = [directory / child.name for child in visible if not _is_folder(child)]
    entries, taken = _bag(directory, files)
    for path in files:
        if path not in taken and not (path.suffix == SUFFIX and is_tuple_file(path)):
            entries += [entry for entry in [_file_entry(path)] if entry is not None]
    # Folders before links to them, so that a log is listed at its real place.
    for folder in sorted(folders, key=lambda one: (one.is_symlink(), one)):
        if folder.resolve() not in met:
            found = _entries(folder, met) or _folder_named_as_log(folder)
            is_nameable = _printable(folder.name) == folder.name or not found
            entries += found if is_nameable else [_broken(folder, NOT_UTF8.format(folder))]
    return sorted(entries, key=lambda entry: entry.path)


def _episodes(directory: Path) -> list[LogEntry]:
    """The episodes of a LeRobot dataset, each a log."""
    try:
        lerobot.read_information(directory)
    except InputError as error:
        return [_broken(directory, str(error))]
    entries, stated = [], lerobot.stated_lengths(directory)
    for path in lerobot.data_files(directory):
        try:
            for episode in lerobot.episodes_of(path):
                name, files = (
                    f"{directory.name}_episode_{episode:06d}",
                    (path, directory / lerobot.INFORMATION),
                )
                length = stated.pop(episode, None)
                entries.append(LogEntry(name, directory, LogFormat.lerobot, files, (), length, episode))
        except InputError as error:
            entries.append(_broken(path, str(error)))
    if stated and entries:
        text = f"{directory.name}: {len(stated)} of the episodes that the dataset states are in none of its files"
        entries[0] = replace(entries[0], notes=(Note(NoteKind.damage, text, len(stated)),))
    return entries or [_broken(directory, f"{directory}: a LeRobot dataset without frames; restore data/")]


def _each_once(entries: list[LogEntry], directory: Path) -> list[LogEntry]:
    """Drop logs whose files are those of another log, or copies of them, and note each at the log that stays."""
    owner_of: dict[object, LogEntry] = {}
    left_out: dict[Path, list[Note]] = {}
    # Single files follow the bags that hold them, and links and copies follow their originals.
    for entry in sorted(entries, key=lambda one: (_is_copy(one.path), -len(one.files), one.path)):
        keys = [(_identity(path), entry.part) for path in entry.files]
        owner = owner_of.get(keys[0]) if keys else None
        if owner is not None and all(key in owner_of for key in keys):
            name = entry.path.relative_to(directory)
            text = f"{name} is a copy of a file of this log, or a link to one, and is not read"
            left_out.setdefault(owner.path, []).append(Note(NoteKind.attention, text))
            left_out[entry.path] = []
        for key in keys:
            owner_of.setdefault(key, entry)
    return [
        replace(entry, notes=(*entry.notes, *left_out.get(entry.path, ())))
        for entry in entries
        if left_out.get(entry.path) != []
    ]


def _is_copy(path: Path) -> bool:
    return path.is_symlink() or _original(path) != path


def _original(path: Path) -> Path:
    """Return the file of which a path is a copy by its name; the path itself if there is no such file.

    After an interrupted compression only the plain file is complete.
    """
    original = (
        path.with_name(path.name.removesuffix(KEPT_COPY) + ".bag") if path.name.endswith(KEPT_COPY) else path
    )
    return next((one for one in (_plain(original), original) if os.path.exists(one)), path)


def _identity(path: Path) -> object:
    """Return what all links to a file and its copies have in common."""
    try:
        status = _original(path).stat()
    except OSError:
        return path
    return status.st_dev, status.st_ino


def _is_folder(child: os.DirEntry[str]) -> bool:
    try:
        return child.is_dir()
    except OSError:  # a broken link
        return False


def _is_file(path: Path) -> bool:
    """Whether it is a regular file; opening a pipe would block. Unreadable files count: their reader reports them."""
    try:
        return why_unreadable(path) is None
    except (FileNotFoundError, ValueError):  # no path holds a zero byte
        return False
    except OSError as error:
        return error.errno != errno.ENAMETOOLONG


def _folder_named_as_log(folder: Path) -> list[LogEntry]:
    reason = f"{folder}: a folder without logs, named as a log is; remove it or name it otherwise"
    return [_broken(folder, reason)] if _format_of(folder) else []


def _plain(path: Path) -> Path:
    """Return the path without a compression suffix."""
    return path.with_suffix("") if path.suffix in COMPRESSED_SUFFIXES else path


def _format_of(path: Path) -> LogFormat | None:
    """Return a file's format, by its name; compressed tables are not supported."""
    if _plain(path).suffix.lower() in can_logs.SUFFIXES and _is_file(path) and can_logs.is_can_log(path):
        return LogFormat.can
    found = FORMATS.get(_plain(path).suffix.lower())
    return None if path != _plain(path) and found in (LogFormat.csv, LogFormat.parquet) else found


def _could_be_log(path: Path) -> bool:
    """Whether a file has a log's suffix, alone or before that of a compression."""
    inner = path.with_suffix("") if path.suffix.lower() in UNREAD_SUFFIXES else path
    return inner.suffix.lower() in FORMATS or (inner != path and _is_file(path) and can_logs.is_can_log(path))


def _printable(name: str) -> str:
    """Return a file's name, with replacement characters where it is not UTF-8."""
    return os.fsencode(name).decode(errors="replace")


def _file_entry(path: Path) -> LogEntry | None:
    if _printable(path.name) != path.name:
        return _broken(path, NOT_UTF8.format(path)) if _could_be_log(path) else None
    log_format = _format_of(path)
    if log_format is None:
        text = f"{path}: compressed as {path.suffix}, which is not read; decompress it"
        return _broken(path, text) if _could_be_log(path) else None
    plain = _plain(path)
    name = plain.name.removesuffix(".active").removesuffix(plain.suffix).removesuffix(".bag")
    try:
        reason = why_unreadable(path)
    except OSError as error:
        reason = f"{path}: cannot be read ({error.strerror}); check where it points to"
    return LogEntry(name, path, log_format, () if reason else (path,), error=reason or "")


def _bag(directory: Path, files: list[Path]) -> tuple[list[LogEntry], set[Path]]:
    """Return the ROS 2 bag among a folder's own files, if there is one, and the files that it accounts for."""
    found = [path for path in files if _plain(path).suffix in BAG_SUFFIXES and _original(path) == path]
    parts = sorted(filter(_is_file, found), key=_part_number)
    place = directory / METADATA
    if place not in files:
        return _split_bag(directory, parts)
    try:
        if (reason := why_unreadable(place)) is not None:
            return [_broken(directory, reason)], set(parts)
        metadata = read_metadata(place)
    except OSError as error:
        text = f"{place}: cannot be read ({error.strerror}); check its permissions"
        return [_broken(directory, text)], set(parts)
    if metadata is None or (
        not metadata.files and not _are_of_one_bag(parts) and any(map(_could_be_log, files))
    ):
        return _split_bag(directory, parts)
    return _described_bag(directory, metadata, parts)


def _split_bag(directory: Path, parts: list[Path]) -> tuple[list[LogEntry], set[Path]]:
    """The bag of files NAME_0, NAME_1, … in a folder NAME without metadata."""
    for suffix in BAG_SUFFIXES:
        own = [
            path
            for path in parts
            if _plain(path).suffix == suffix and _bag_name(path) == directory.name != _plain(path).stem
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
    present = [path for path in listed if _is_file(path)]
    if not present and (_are_of_one_bag(parts) or len(parts) == len(listed)):
        present = parts
    taken = {*listed, *present}
    place, names = directory / METADATA, ", ".join(metadata.files) or "none"
    formats = {kind for path in present if (kind := _format_of(path)) is not None}
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
        return [_broken(directory, reason)], taken
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
    return len({(_bag_name(path), _plain(path).suffix) for path in parts}) == 1


def _bag_name(path: Path) -> str:
    """Return the name of the bag of which a file is a part, by the file's name."""
    match = SPLIT_NAME.fullmatch(_plain(path).stem)
    return match["stem"] if match else _plain(path).stem


def _existing_variant(path: Path) -> Path:
    """Return the existing variant of a listed file, which may have been compressed or decompressed since."""
    plain = _plain(path)
    others = [plain, *(plain.with_name(plain.name + suffix) for suffix in COMPRESSED_SUFFIXES)]
    return next((other for other in [path, *others] if _is_file(other)), path)


def _part_number(path: Path) -> tuple[int, str]:
    match = SPLIT_NAME.fullmatch(_plain(path).stem)
    return (int(match["number"]) if match else 0, path.name)


def _broken(path: Path, reason: str) -> LogEntry:
    return LogEntry(_printable(path.name), path, LogFormat.mcap, (), error=reason)
