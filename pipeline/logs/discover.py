"""Finds the logs in a folder: bags of every format and tables, in any mix and depth."""

import enum
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from pipeline.errors import InputError

METADATA = "metadata.yaml"
YamlLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same, ten times faster where it was built
MAXIMUM_METADATA_CHARACTERS = 1 << 22
SPLIT_NAME = re.compile(r"(?P<stem>.+)_(?P<number>\d+)")


class LogFormat(enum.StrEnum):
    """File formats, by what reads them."""

    mcap = "mcap"
    rosbag1 = "rosbag1"
    sqlite3 = "sqlite3"
    csv = "csv"
    parquet = "parquet"


FORMATS = {
    ".mcap": LogFormat.mcap,
    ".bag": LogFormat.rosbag1,
    ".active": LogFormat.rosbag1,  # what a crashed `rosbag record` leaves
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
        format: What reads its files.
        files: Its files in the order of recording.
        missing: Files that `metadata.yaml` lists and that are not there.
        error: Why it cannot be read at all, if that is known already; `read_log` raises it.
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
    `NAME_1.mcap` in the folder NAME) are one bag too. Names that begin with a dot are passed over.

    Raises:
        InputError: The folder does not exist, cannot be read, or holds no log.
    """
    if not directory.exists():
        raise InputError(f"{directory}: no such folder; name a folder of logs")
    entries = (
        _entries(directory) if directory.is_dir() else [e for e in [_file_entry(directory)] if e is not None]
    )
    if not entries:
        expected = "ROS 1 .bag, ROS 2 folders or .db3, .mcap, .csv, .parquet"
        raise InputError(f"{directory}: holds no logs ({expected}); name a folder of logs")
    return _with_unique_names(entries, directory)


def _entries(directory: Path) -> list[LogEntry]:
    try:
        children = sorted(os.scandir(directory), key=lambda child: child.name)
    except OSError as error:
        text = f"{directory}: cannot be read ({error.strerror}); check the folder's permissions"
        return [_broken(directory, text)]
    if any(child.name == METADATA for child in children):
        return [_bag_folder(directory)]
    files = [directory / child.name for child in children if child.name[0] != "." and child.is_file()]
    folders = [
        directory / child.name
        for child in children
        if child.name[0] != "."
        and child.is_dir(follow_symlinks=True)
        and not _is_loop(directory / child.name)
    ]
    entries = _split_bag(directory, files)
    taken = {path for entry in entries for path in entry.files}
    entries += [entry for path in files if path not in taken and (entry := _file_entry(path)) is not None]
    for folder in folders:
        entries += _entries(folder)
    return sorted(entries, key=lambda entry: entry.path)


def _is_loop(folder: Path) -> bool:
    """Whether a symbolic link leads to a folder that holds it."""
    return folder.is_symlink() and folder.absolute().is_relative_to(folder.resolve())


def _file_entry(path: Path) -> LogEntry | None:
    if path.suffix not in FORMATS:
        return None
    name = path.name.removesuffix(".active").removesuffix(path.suffix).removesuffix(".bag")
    return LogEntry(name, path, FORMATS[path.suffix], (path,))


def _split_bag(directory: Path, files: list[Path]) -> list[LogEntry]:
    """Files NAME_0, NAME_1, … in a folder NAME that lost its metadata."""
    for suffix in (".mcap", ".db3"):
        parts = []
        for path in files:
            match = SPLIT_NAME.fullmatch(path.stem)
            if path.suffix == suffix and match and match["stem"] == directory.name:
                parts.append((int(match["number"]), path))
        if parts:
            return [
                LogEntry(directory.name, directory, FORMATS[suffix], tuple(path for _, path in sorted(parts)))
            ]
    return []


def _bag_folder(directory: Path) -> LogEntry:
    """A ROS 2 bag folder, as its metadata describes it."""
    place = directory / METADATA
    try:
        with place.open(encoding="utf-8") as file:
            information = yaml.load(file.read(MAXIMUM_METADATA_CHARACTERS), Loader=YamlLoader)[
                "rosbag2_bagfile_information"
            ]
        listed = [str(name) for name in information["relative_file_paths"]]
    except OSError as error:
        return _broken(directory, f"{place}: cannot be read ({error.strerror}); check its permissions")
    except (yaml.YAMLError, ValueError, KeyError, TypeError, RecursionError):
        listed = []  # damaged metadata: the files themselves say what they hold
    paths = [directory / Path(name).name for name in listed]  # older releases list them with the folder
    present = [path for path in paths if path.exists()]
    if not present:
        present = sorted(path for path in directory.iterdir() if path.suffix in (".mcap", ".db3"))
    if not present:
        listing = ", ".join(listed) or "none"
        return _broken(directory, f"{directory}: a bag folder without its files; {METADATA} lists {listing}")
    formats = {FORMATS[path.suffix] for path in present if path.suffix in FORMATS}
    if len(formats) != 1:
        return _broken(
            directory, f"{place}: lists files that are neither .mcap nor .db3: {', '.join(listed)}"
        )
    missing = tuple(path.name for path in paths if not path.exists())
    return LogEntry(directory.name, directory, formats.pop(), tuple(present), missing)


def _broken(path: Path, reason: str) -> LogEntry:
    return LogEntry(path.name, path, LogFormat.mcap, (), error=reason)


def _with_unique_names(entries: list[LogEntry], directory: Path) -> list[LogEntry]:
    """Name logs by file name; where two share one, put the folders before it."""
    names = [entry.name for entry in entries]
    unique = []
    for entry in entries:
        name = entry.name
        if names.count(name) > 1:
            parents = entry.path.relative_to(directory).parts[:-1]
            name = "_".join((*parents, name)) + (
                "" if entry.path.is_dir() else entry.path.suffix.replace(".", "_")
            )
        unique.append(replace(entry, name=name.replace("#", "_")))
    return unique
