"""Hold the rows that were read from table `messages` against what the file says of itself."""

import sqlite3
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from pipeline.logs.formats.sqlite3.pages import LEAST_CELL_BYTES, PageRows
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS, ReadingLedger

LISTED = 3
# The index of times lists every row, apart from the table. The limit bounds the time that a circle of pages takes.
COUNT_IN_INDEX = "SELECT count(*) FROM (SELECT 1 FROM messages INDEXED BY timestamp_idx LIMIT ?)"
LEAST_LIMIT = 1_000_000


class RowCount:
    """Counts rows, gaps in their numbers, and rows without a usable message.

    `ros2 bag record` numbers the rows of each file 1, 2, 3, ….
    """

    def __init__(self, file_bytes: int) -> None:
        self.most_in_gap = file_bytes // LEAST_CELL_BYTES  # a longer gap is another way of numbering
        self.n_rows = self.last = 0
        self.gaps: list[tuple[int, int]] = []  # the first few, with their first and last row
        self.n_missing = 0
        self.unusable: list[int] = []  # the first few rows
        self.n_unusable = 0

    def add(self, rows: PageRows) -> np.ndarray:
        """Count some rows in ascending order, and return the places of the usable ones among them, shape (n,)."""
        first = np.maximum(np.concatenate(([self.last], rows.number[:-1])), 0) + 1
        width = rows.number - first
        is_gap = (width > 0) & (width <= self.most_in_gap)
        ends = zip(first[is_gap].tolist(), (rows.number[is_gap] - 1).tolist(), strict=True)
        self.gaps += [*ends][: LISTED - len(self.gaps)]
        self.n_missing += int(width[is_gap].sum())
        self.n_rows, self.last = self.n_rows + len(rows.number), int(rows.number[-1])
        usable = (rows.time_ns >= 0) & (rows.time_ns <= MAXIMUM_TIME_NS)
        self.unusable += rows.number[~usable].tolist()[: LISTED - len(self.unusable)]
        self.n_unusable += int((~usable).sum())
        return np.flatnonzero(usable)

    def tell(self, ledger: ReadingLedger, connection: sqlite3.Connection) -> None:
        """Note in the ledger what is missing or unusable, and a difference from the index of times."""
        if self.n_unusable:
            places = _abridged(self.unusable, self.n_unusable)
            lost = (
                f"{self.n_unusable} rows hold no message or an impossible time (rows {places}); they are lost"
            )
            ledger.damage(None, lost, self.n_unusable)
        if self.n_missing:
            gaps = [f"{first} to {last}" if first < last else str(first) for first, last in self.gaps]
            n_listed = sum(last - first + 1 for first, last in self.gaps)
            places = _abridged(gaps, len(gaps) + (self.n_missing > n_listed))
            lost = f"row numbers are missing ({places}): {self.n_missing} messages are lost or were deleted"
            ledger.damage(None, lost, self.n_missing)
        limit = max(2 * self.n_rows, LEAST_LIMIT)
        with suppress(sqlite3.Error, UnicodeDecodeError):  # there is no such index, or it is damaged
            (n_indexed,) = connection.execute(COUNT_IN_INDEX, (limit,)).fetchone()
            if n_indexed < limit:
                ledger.compare_counts("its index of times lists", n_indexed, self.n_rows)


def _abridged(listed: Sequence[object], n_all: int) -> str:
    return ", ".join(map(str, listed)) + (", …" if n_all > len(listed) else "")
