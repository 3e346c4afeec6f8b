"""Folders of recorded bags: a new recording deletes only what the stage wrote itself."""

import os
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.logs.formats.writer import partial_bag

RECORDED = "recorded.txt"  # lists recorded bags, a path a line; lies beside their folders


def refuse_foreign(folders: Iterable[Path], is_own: Callable[[Path], bool], stage: str, remedy: str) -> None:
    """Raise `InputError` if a folder holds an entry that the stage did not write; hidden entries do not count.

    All folders are checked before any is changed.

    Args:
        folders: Folders to be deleted; they may be missing.
        is_own: Whether the stage wrote an entry.
        stage: Name of the stage, for the message.
        remedy: Advice, for the message.
    """
    for folder in folders:
        present = [folder] if folder.exists() and not folder.is_dir() else sorted(folder.glob("[!.]*"))
        for entry in present:
            if not is_own(entry):
                raise InputError(f"{folder}: holds logs that {stage} did not write ({entry.name}); {remedy}")


def list_recorded(output: Path, bags: Iterable[Path]) -> None:
    """List the bags below `output` that a stage is about to record; `clear_recorded` deletes only these."""
    lines = [f"{bag.relative_to(output).as_posix()}\n" for bag in bags]
    write_whole(output / RECORDED, "".join(lines).encode())


def clear_recorded(output: Path, names: Iterable[str], stage: str, own_logs: Mapping[str, str]) -> None:
    """Delete the bags that a stage recorded in folders of `output`, and create missing folders.

    Args:
        output: Parent of the folders and of the list of recorded bags.
        names: Names of the folders.
        stage: Name of the stage, for the message.
        own_logs: The user's logs that replace recordings, by the settings' names.

    Raises:
        InputError: A folder holds something else, or the user's logs.
    """
    folders = [output / name for name in names]
    for setting, logs in own_logs.items():
        for folder in folders:
            _refuse_common(setting, logs, folder)
    path = output / RECORDED
    listed = (
        {output / line for line in path.read_text(encoding="utf-8").splitlines()} if path.exists() else set()
    )
    refuse_foreign(
        folders,
        lambda entry: entry in listed and not entry.is_symlink(),
        stage,
        f"move them to a folder of their own; only what {path} lists is made anew",
    )
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
        for bag in listed & set(folder.iterdir()):
            shutil.rmtree(bag)
        for bag in listed:
            if bag.parent == folder:  # the unfinished bag of a killed run
                shutil.rmtree(partial_bag(bag), ignore_errors=True)
    path.unlink(missing_ok=True)


def _refuse_common(setting: str, logs: str, folder: Path) -> None:
    """Raise `InputError` if emptying the folder could delete some of the logs, links followed."""
    named, emptied = (Path(os.path.realpath(path)) for path in (logs, folder))
    if named.is_relative_to(emptied):
        relation = "lies in"
    elif emptied.is_relative_to(named) and emptied.is_dir() and any(emptied.iterdir()):
        relation = "contains"
    else:
        return
    raise InputError(
        f"{setting}={logs}: {relation} {folder}, whose recordings are deleted where own logs take their place; "
        "move your logs to a folder of their own"
    )
