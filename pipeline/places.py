"""Where a command reads and writes: no place is for both."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from pipeline.errors import InputError


def refuse_overlap(writes: Mapping[str, str], reads: Mapping[str, str | Iterable[str]]) -> None:
    """Raise `InputError` if a place to write is, contains or lies in a place to read, links followed.

    Args:
        writes: Paths by the names of the settings that give them.
        reads: The same; a setting may give several paths.
    """
    for name, given in reads.items():
        for path in [given] if isinstance(given, str) else given:
            for written, output in writes.items():
                relation = _relation(output, path)
                if relation:
                    raise InputError(
                        f"{written}={output}: {relation} {name}={path}, which is only read; name another {written}"
                    )


def _relation(output: str, read: str) -> str | None:
    """How a place to write stands to one to read; None: apart."""
    # unlike Path.resolve it does not mind links that are loops
    own, other = (Path(os.path.realpath(path)) for path in (output, read))
    if own == other:
        return "is"
    if other.is_relative_to(own):
        return "contains"
    return "lies in" if own.is_relative_to(other) else None
