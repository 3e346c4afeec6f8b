"""Folders of bags that are made anew: what a stage did not write there itself is not deleted."""

from collections.abc import Callable, Iterable
from pathlib import Path

from pipeline.errors import InputError


def refuse_foreign(folders: Iterable[Path], is_own: Callable[[Path], bool], stage: str, remedy: str) -> None:
    """Raise `InputError` if a folder holds an entry that the stage did not write; hidden entries do not count.

    All folders are to be looked at before any is touched.

    Args:
        folders: That are to be deleted; they may be missing.
        is_own: Whether the stage wrote an entry.
        stage: Its name, for the message.
        remedy: What to do, for the message; `{folder}` in it stands for the folder.
    """
    for folder in folders:
        present = [folder] if folder.exists() and not folder.is_dir() else sorted(folder.glob("[!.]*"))
        for entry in present:
            if not is_own(entry):
                raise InputError(
                    f"{folder}: holds logs that {stage} did not write ({entry.name}); "
                    + remedy.format(folder=folder)
                )
