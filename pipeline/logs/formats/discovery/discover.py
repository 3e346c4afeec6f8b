"""Find the logs in a folder: bags of every format and tables, mixed and in subfolders."""

import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.formats.discovery.duplicates import each_once
from pipeline.logs.formats.discovery.log_entry import (
    NOT_UTF8,
    LogEntry,
    broken,
    file_entry,
    format_of,
    printable,
)
from pipeline.logs.formats.discovery.log_names import unique_names
from pipeline.logs.formats.discovery.rosbag2_folders import bag_of
from pipeline.logs.formats.lerobot.episodes import dataset_of
from pipeline.logs.tuples import SUFFIX, is_tuple_file


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
    if printable(str(directory)) != str(directory):
        raise InputError(NOT_UTF8.format(directory))
    if not directory.is_dir():
        entries = [entry for entry in [file_entry(directory)] if entry is not None]
    else:
        entries = each_once(_entries(directory, set()), directory)
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


def _entries(directory: Path, met: set[Path], taken: Collection[Path] = ()) -> list[LogEntry]:
    """Find the logs of a folder.

    Args:
        met: Folders searched already, to which links may lead back.
        taken: Files that belong to a log of a folder above.
    """
    met.add(directory.resolve())
    try:
        children = sorted(os.scandir(directory), key=lambda child: child.name)
    except OSError as error:
        text = f"{directory}: cannot be read ({error.strerror}); check the folder's permissions"
        return [broken(directory, text)]
    visible = [child for child in children if child.name[0] != "."]
    folders = [directory / child.name for child in visible if _is_folder(child)]
    files = [directory / child.name for child in visible if not _is_folder(child)]
    episodes, frames = dataset_of(directory)
    bag, parts = bag_of(directory, [path for path in files if path not in taken])
    entries, taken = [*episodes, *bag], {*taken, *frames, *parts}
    for path in files:
        if path not in taken and not (path.suffix == SUFFIX and is_tuple_file(path)):
            entries += [entry for entry in [file_entry(path)] if entry is not None]
    # Folders before links to them, so that a log is listed at its real place.
    for folder in sorted(folders, key=lambda one: (one.is_symlink(), one)):
        if folder.resolve() not in met:
            found = _entries(folder, met, taken) or _folder_named_as_log(folder)
            is_nameable = printable(folder.name) == folder.name or not found
            entries += found if is_nameable else [broken(folder, NOT_UTF8.format(folder))]
    return sorted(entries, key=lambda entry: entry.path)


def _is_folder(child: os.DirEntry[str]) -> bool:
    try:
        return child.is_dir()
    except OSError:  # a broken link
        return False


def _folder_named_as_log(folder: Path) -> list[LogEntry]:
    reason = f"{folder}: a folder without logs, named as a log is; remove it or name it otherwise"
    return [broken(folder, reason)] if format_of(folder) else []
