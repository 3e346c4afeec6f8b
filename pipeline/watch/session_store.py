"""The state of a watch: one file per session, named by its content, and the acts of maintenance.

A file appears whole or not at all, and holds facts alone: what the log says. All else follows from them each time. So
a kill at any moment loses no session and counts none twice, nor do two looks at the same time.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.files.atomic import write_json

FOLDER, MAINTENANCE = "sessions", "baselines.json"


@dataclass(frozen=True)
class SessionRecord:
    """One session.

    Attributes:
        content: What identifies it.
        name: Of its log.
        path: Where its log was seen last.
        files: Every set of files that it was read from, as they were then, `files_of`.
        begin_ns: Absolute stamp of its first row.
        end_ns: Of its last one.
        known_as: Key of the nominal sessions, settings and code that the statistics follow from.
        statistics: Per joint, in the order of `STATISTICS`; None of a joint that hardly moved.
    """

    content: str
    name: str
    path: str
    files: list[list[str]]
    begin_ns: int
    end_ns: int
    known_as: str
    statistics: list[list[float | None]]

    @property
    def values(self) -> np.ndarray:
        """(n_joint, n_statistic); NaN where nothing is said."""
        return np.array(self.statistics, float)


class SessionStore:
    """Sessions in a folder.

    Args:
        folder: Of the state.

    Raises:
        InputError: A file is not what this class writes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.records: dict[str, SessionRecord] = {}
        for path in sorted((folder / FOLDER).glob("*.json")):
            record = _read(path)
            self.records[record.content] = record

    def add(self, record: SessionRecord) -> None:
        """Keep a session, in the place of what was known of the same content; a copy's files are added.

        Raises:
            InputError: The file cannot be written.
        """
        former = self.records.get(record.content)
        if former is not None and former.known_as == record.known_as:
            record = replace(record, files=[*former.files, *record.files])
        write_json(self._folder / FOLDER / f"{record.content[:32]}.json", asdict(record), allow_nan=False)
        self.records[record.content] = record

    def baselines(self) -> list[int]:
        """Stamps [ns] from which on sessions are a new baseline.

        Raises:
            InputError: Their file is damaged.
        """
        path = self._folder / MAINTENANCE
        if not path.exists():
            return []
        try:
            return sorted({int(stamp) for stamp in json.loads(path.read_text())})
        except (ValueError, TypeError) as error:
            raise InputError(f"{path}: not a list of stamps ({error}); correct or delete it") from error

    def begin_baseline(self, stamp_ns: int) -> None:
        """Let sessions from a stamp on be a new baseline; the same stamp twice is one.

        Raises:
            InputError: The file is damaged, or cannot be written.
        """
        write_json(self._folder / MAINTENANCE, sorted({*self.baselines(), stamp_ns}))


def _read(path: Path) -> SessionRecord:
    try:
        return SessionRecord(**json.loads(path.read_text()))
    except (ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: not the record of a session ({error}); delete it") from error


def in_order(records: Iterable[SessionRecord]) -> tuple[list[SessionRecord], list[tuple[str, str]]]:
    """Sessions as they were recorded, and those that count as parts of another, with its name.

    Of sessions whose stamps overlap the longest counts: a log that was copied while it grew, or cut.
    """
    kept: list[SessionRecord] = []
    parts: list[tuple[str, str]] = []
    for record in sorted(records, key=lambda of: (of.begin_ns - of.end_ns, of.begin_ns, of.content)):
        whole = next((one for one in kept if _overlap(one, record)), None)
        if whole is None:
            kept.append(record)
        elif record.path != whole.path:  # else the log has grown since
            parts.append((record.name, whole.name))
    return sorted(kept, key=lambda of: of.begin_ns), parts


def _overlap(one: SessionRecord, other: SessionRecord) -> bool:
    return one.begin_ns < other.end_ns and other.begin_ns < one.end_ns


def listed(values: np.ndarray) -> list[list[float | None]]:
    """(n_joint, n_statistic) as JSON holds it."""
    return [[None if np.isnan(value) else float(value) for value in row] for row in values]
