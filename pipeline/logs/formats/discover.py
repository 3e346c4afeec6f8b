"""Find the logs in a folder: bags of every format and tables, mixed and in subfolders."""

import enum
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from pipeline.errors import InputError
from pipeline.logs.formats.compressed_file import COMPRESSED_SUFFIXES
from pipeline.logs.formats.opened_file import why_unreadable

METADATA = "metadata.yaml"
YamlLoader = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # the C loader is ten times faster, where available
MAXIMUM_METADATA_CHARACTERS = 1 << 22
SPLIT_NAME = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


class LogFormat(enum.StrEnum):
    """File formats, by their reader."""

    mcap = "mcap"
    rosbag1 = "rosbag1"
    sqlite3 = "sqlite3"
    csv = "csv"
    parquet = "parquet"


BAG_SUFFIXES = (".mcap", ".db3")  # of ROS 2
COMPRESSION_FORMATS = ("", "zstd")
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
        missing: Files that `metadata.yaml` lists but that are absent.
        error: Why it cannot be read, if already known; `read_log` raises it.
    """

    name: str
    path: Path
    format: LogFormat
    files: tuple[Path, ...]
    missing: tuple[str, ...] = ()
    error: str = ""


def find_logs(directory: Path) -> list[LogEntry]:
    """Find all logs in a folder and its subfolders, ordered by path; a bag's own path is allowed too.

    A folder with `metadata.yaml` is one ROS 2 bag. Split files of a folder without it (`NAME_0.mcap`,
    `NAME_1.mcap` in the folder NAME) are one bag too. Each may be compressed as a file (`NAME_0.mcap.zstd`). Names
    that begin with a dot are passed over.

    Raises:
        InputError: The folder does not exist, cannot be read, or holds no log.
    """
    if not directory.exists():
        raise InputError(f"{directory}: no such folder; name a folder of logs")
    entries = (
        _entries(directory, set())
        if directory.is_dir()
        else [e for e in [_file_entry(directory)] if e is not None]
    )
    if not entries:
        expected = "ROS 1 .bag, ROS 2 folders or .db3, .mcap, these with .zstd, .csv, .parquet"
        raise InputError(f"{directory}: holds no logs ({expected}); name a folder of logs")
    return _with_unique_names(entries, directory)


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
    if any(child.name == METADATA for child in children):
        return [_bag_folder(directory)]
    visible = [child for child in children if child.name[0] != "."]
    folders = [directory / child.name for child in visible if _is_folder(child)]
    files = _without_copies([directory / child.name for child in visible if not _is_folder(child)])
    entries = _split_bag(directory, files)
    taken = {path for entry in entries for path in entry.files}
    entries += [entry for path in files if path not in taken and (entry := _file_entry(path)) is not None]
    # Folders before links to them, so that a log is listed at its real place.
    for folder in sorted(folders, key=lambda one: (one.is_symlink(), one)):
        if folder.resolve() not in met:
            entries += _entries(folder, met) or _folder_named_as_log(folder)
    return sorted(entries, key=lambda entry: entry.path)


def _is_folder(child: os.DirEntry[str]) -> bool:
    try:
        return child.is_dir()
    except OSError:  # a broken link
        return False


def _is_file(path: Path) -> bool:
    """Whether it is a regular file; opening a pipe would block. Unreadable files count: their reader reports them."""
    try:
        return why_unreadable(path) is None
    except FileNotFoundError:
        return False
    except OSError:
        return True


def _folder_named_as_log(folder: Path) -> list[LogEntry]:
    reason = f"{folder}: a folder without logs, named as a log is; remove it or name it otherwise"
    return [_broken(folder, reason)] if _format_of(folder) else []


def _plain(path: Path) -> Path:
    """Return the path without a compression suffix."""
    return path.with_suffix("") if path.suffix in COMPRESSED_SUFFIXES else path


def _without_copies(files: list[Path]) -> list[Path]:
    """Drop compressed files whose plain file exists: after an interrupted compression only that one is complete."""
    plain = {path for path in files if path == _plain(path)}
    return [path for path in files if path in plain or _plain(path) not in plain]


def _format_of(path: Path) -> LogFormat | None:
    """Return a file's format, by its name; compressed tables are not supported."""
    found = FORMATS.get(_plain(path).suffix)
    return None if path != _plain(path) and found in (LogFormat.csv, LogFormat.parquet) else found


def _file_entry(path: Path) -> LogEntry | None:
    log_format = _format_of(path)
    if log_format is None:
        return None
    plain = _plain(path)
    name = plain.name.removesuffix(".active").removesuffix(plain.suffix).removesuffix(".bag")
    try:
        reason = why_unreadable(path)
    except OSError as error:
        reason = f"{path}: cannot be read ({error.strerror}); check where it points to"
    return LogEntry(name, path, log_format, () if reason else (path,), error=reason or "")


def _split_bag(directory: Path, files: list[Path]) -> list[LogEntry]:
    """The bag of files NAME_0, NAME_1, … in a folder NAME without metadata."""
    for suffix in BAG_SUFFIXES:
        parts = []
        for path in files:
            plain = _plain(path)
            match = SPLIT_NAME.fullmatch(plain.stem)
            if plain.suffix == suffix and match and match["stem"] == directory.name and _is_file(path):
                parts.append((int(match["number"]), path))
        if parts:
            return [
                LogEntry(directory.name, directory, FORMATS[suffix], tuple(path for _, path in sorted(parts)))
            ]
    return []


def _bag_folder(directory: Path) -> LogEntry:
    """A ROS 2 bag folder, read from its metadata."""
    place = directory / METADATA
    try:
        if (reason := why_unreadable(place)) is not None:
            return _broken(directory, reason)
        with place.open(encoding="utf-8") as file:
            information = yaml.load(file.read(MAXIMUM_METADATA_CHARACTERS), Loader=YamlLoader)[
                "rosbag2_bagfile_information"
            ]
        listed = [str(name) for name in information["relative_file_paths"]]
        is_compressed = str(information.get("compression_mode") or "none").lower() != "none"
        compression = str(information.get("compression_format")) if is_compressed else ""
    except OSError as error:
        return _broken(directory, f"{place}: cannot be read ({error.strerror}); check its permissions")
    except (yaml.YAMLError, ValueError, KeyError, TypeError, RecursionError):
        listed, compression = [], ""  # damaged metadata: search the files themselves
    if compression not in COMPRESSION_FORMATS:
        text = f"{place}: the bag is compressed as {compression}, which is not read; convert it with `ros2 bag convert`"
        return _broken(directory, text)
    # Older releases list files with their folder.
    paths = [_existing_variant(directory / Path(name).name) for name in listed]
    present = [path for path in paths if _is_file(path)]
    if not present:
        found = [
            path for path in directory.iterdir() if _plain(path).suffix in BAG_SUFFIXES and path.is_file()
        ]
        present = sorted(_without_copies(found), key=_part_number)
    if not present:
        listing = ", ".join(listed) or "none"
        return _broken(directory, f"{directory}: a bag folder without its files; {METADATA} lists {listing}")
    formats = {kind for path in present if (kind := _format_of(path)) is not None}
    if len(formats) != 1:
        return _broken(
            directory, f"{place}: lists files that are neither .mcap nor .db3: {', '.join(listed)}"
        )
    missing = tuple(path.name for path in paths if path not in present)
    return LogEntry(directory.name, directory, formats.pop(), tuple(present), missing)


def _existing_variant(path: Path) -> Path:
    """Return the existing variant of a listed file, which may have been compressed or decompressed since."""
    plain = _plain(path)
    others = [plain, *(plain.with_name(plain.name + suffix) for suffix in COMPRESSED_SUFFIXES)]
    return next((other for other in [path, *others] if other.exists()), path)


def _part_number(path: Path) -> tuple[int, str]:
    match = SPLIT_NAME.fullmatch(_plain(path).stem)
    return (int(match["number"]) if match else 0, path.name)


def _broken(path: Path, reason: str) -> LogEntry:
    return LogEntry(path.name, path, LogFormat.mcap, (), error=reason)


def _with_unique_names(entries: list[LogEntry], directory: Path) -> list[LogEntry]:
    """Name logs by file name; put the folders before a name that occurs twice."""
    names = [entry.name for entry in entries]
    unique = []
    for entry in entries:
        name = entry.name
        if names.count(name) > 1:
            parents = entry.path.relative_to(directory).parts[:-1]
            name = "_".join((*parents, name)) + (
                "" if entry.path.is_dir() else "".join(_suffixes(entry.path)).replace(".", "_")
            )
        unique.append(replace(entry, name=name.replace("#", "_")))
    return unique


def _suffixes(path: Path) -> tuple[str, ...]:
    plain = _plain(path)
    return (plain.suffix,) if plain == path else (plain.suffix, path.suffix)
