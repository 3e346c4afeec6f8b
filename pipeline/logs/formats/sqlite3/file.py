"""Read ROS 2 bags stored in SQLite (`.db3`), intact or damaged.

If a crash left a journal beside the file, both are copied to a temporary folder and SQLite rolls the copy back. The
user's file is never written.
"""

import shutil
import sqlite3
import tempfile
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.compression.bounded_decompression import MAXIMUM_CHUNK_BYTES
from pipeline.logs.formats.compression.message_compression import decompressed_messages
from pipeline.logs.formats.opened_file import OpenedFile, opened_file
from pipeline.logs.formats.sqlite3.connection import plain_tables, read_only
from pipeline.logs.formats.sqlite3.pages import PageRows, UnusualError, rows_in_pages, truncated_rows
from pipeline.logs.formats.sqlite3.row_count import RowCount
from pipeline.logs.messages.decoding.definitions import full_type_name
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock, ReadingLedger, by_topic
from pipeline.logs.messages.raw_log import Note, NoteKind

MAGIC = b"SQLite format 3\x00"
JOURNALS = ("-journal", "-wal")  # `-shm` is only an index of `-wal`, and readers leave it behind
BATCH_ROWS = 4096
BATCH_BYTES = 1 << 23
ATTEMPTS_PAST_DAMAGE = 24
BEFORE_ALL_ROWS = -1 << 62
NO_TIME = -1
FAULTS = (sqlite3.Error, UnicodeDecodeError)  # the latter if SQLite's own message quotes damaged text
MAXIMUM_MESSAGE_BYTES = 1 << 26  # of a wanted topic: joint states are far shorter, and are copied thrice
# For other topics only the length is read, which spares SQLite the message's further pages.
QUERY = """
    SELECT rowid, topic_id, timestamp, CASE
        WHEN typeof(data) <> 'blob' THEN NULL
        WHEN topic_id IN ({wanted}) AND length(data) <= {most} THEN data
        ELSE length(data) END
    FROM messages WHERE rowid > ? AND rowid NOT IN ({cut}) ORDER BY rowid LIMIT ?"""
WITHOUT_LIMIT = -1
Row = tuple[int, int, int, bytes | int]  # row number, topic, time, message or its length


def read_sqlite3(path: Path, ledger: ReadingLedger, wanted: Container[str]) -> Iterator[MessageBlock]:
    """Yield the wanted topics' messages of one file in the order of recording.

    Raises:
        InputError: The file cannot be opened or is not a ROS 2 bag.
    """
    with opened_file(path, ledger) as opened:
        if opened.file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path}: not an SQLite file (its first bytes are not SQLite's); remove it")
        try:
            with _database(opened) as (connection, has_journal):
                topics = _topics(connection, path)
                for topic in topics.values():
                    ledger.add_topic(topic)
                yield from _Messages(connection, topics, opened, wanted).blocks(has_journal)
        except FAULTS as error:
            raise InputError(
                f"{path}: SQLite cannot read it ({error}); it is damaged from its start"
            ) from error


@contextmanager
def _database(opened: OpenedFile) -> Iterator[tuple[sqlite3.Connection, bool]]:
    """Open the file so that SQLite writes nothing beside it, and tell whether a crash left a journal."""
    path = opened.path
    journals = [path.with_name(path.name + suffix) for suffix in JOURNALS]
    left = [journal for journal in journals if journal.exists() and journal.stat().st_size]
    with tempfile.TemporaryDirectory() as folder:
        if left:
            copy = Path(folder) / path.name
            for source in (path, *left):
                shutil.copyfile(source, copy.with_name(source.name))
            names = ", ".join(journal.name for journal in left)
            text = f"{path.name}: a crash left {names}; SQLite rolled a copy back"
            opened.ledger.notes.append(Note(NoteKind.attention, text))
            address = copy.as_uri()
        else:
            address = f"{path.resolve().as_uri()}?immutable=1"
        with read_only(address, opened.size, MAXIMUM_CHUNK_BYTES) as connection:
            yield connection, bool(left)


def _topics(connection: sqlite3.Connection, path: Path) -> dict[int, LoggedTopic]:
    tables = plain_tables(connection)
    if not {"topics", "messages"} <= tables:
        found = ", ".join(sorted(tables)) or "none"
        raise InputError(
            f"{path}: an SQLite file, but not a ROS 2 bag (tables: {found}); remove it, or restore it if it was one"
        )
    definitions: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        rows = connection.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        definitions = {str(name): (str(text or ""), str(encoding or "")) for name, encoding, text in rows}
    columns = [name for _, name, *_ in connection.execute("PRAGMA table_info(topics)")]
    encoding_column = "serialization_format" if "serialization_format" in columns else "'cdr'"  # none in 2018
    topics = {}
    for number, name, type_name, encoding in connection.execute(
        f"SELECT id, name, type, {encoding_column} FROM topics"
    ):
        if not isinstance(number, int):
            continue
        text, text_format = definitions.get(str(type_name), ("", "ros2msg"))
        topics[number] = LoggedTopic(
            str(name), full_type_name(str(type_name)), str(encoding), text, text_format
        )
    return topics


class _Messages:
    """One pass over the table `messages`."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        topics: dict[int, LoggedTopic],
        opened: OpenedFile,
        wanted: Container[str],
    ) -> None:
        self.connection = connection
        self.topics = topics
        self.opened = opened
        self.ledger = opened.ledger
        self.wanted_names = wanted
        self.wanted = {number for number, topic in topics.items() if topic.name in wanted}
        self.last = BEFORE_ALL_ROWS  # the last row read
        self.n_bytes = 0  # of all messages so far

    def blocks(self, has_journal: bool) -> Iterator[MessageBlock]:
        """Count the messages of all topics, yield blocks of the wanted ones, and note which rows are missing."""
        counted = RowCount(self.opened.size)
        for rows in self.rows(has_journal):
            usable = counted.add(rows)
            for topic, own in by_topic(rows.topic[usable], self.topics):
                if topic is None:
                    lost = f"{len(own)} messages belong to a topic that is not described"
                    self.ledger.damage(None, lost, len(own))
                    continue
                self.ledger.count(topic, len(own))
                if topic.name in self.wanted_names:
                    own = usable[own]
                    columns = rows.time_ns[own], rows.data, rows.start[own], rows.length[own]
                    yield from decompressed_messages(MessageBlock(topic, *columns), self.ledger)
        counted.tell(self.ledger, self.connection)

    def rows(self, has_journal: bool) -> Iterator[PageRows]:
        """Yield rows in the order of recording: from the pages as long as these are as expected, then row by row."""
        if not has_journal:
            with suppress(UnusualError):
                for rows in rows_in_pages(self.opened.file, self.opened.size, self.connection, self.wanted):
                    self.last, self.n_bytes = int(rows.number[-1]), self.n_bytes + int(rows.length.sum())
                    yield rows
                return
        yield from map(_joined, filter(None, self.batches()))

    def batches(self) -> Iterator[list[Row]]:
        """Yield rows in the order of recording; continue after damaged pages."""
        query = QUERY.format(
            wanted=_listed(self.wanted),
            most=MAXIMUM_MESSAGE_BYTES,
            cut=_listed(truncated_rows(self.opened.file, self.opened.size)),
        )
        batch: list[Row] = []
        n_batch_bytes = attempts = 0
        step = 1
        while attempts < ATTEMPTS_PAST_DAMAGE:
            before = self.last
            try:
                for row in self.connection.execute(query, (self.last, WITHOUT_LIMIT)):
                    self.take(row, batch)
                    n_batch_bytes += len(row[3]) if isinstance(row[3], bytes) else 0
                    if len(batch) >= BATCH_ROWS or n_batch_bytes >= BATCH_BYTES:
                        yield batch
                        batch, n_batch_bytes = [], 0
                break
            except FAULTS as error:
                fault = error
            step = 1 if self.last > before else step
            if self.n_bytes <= self.opened.size and self.take_next(query, batch):
                step = 1
                continue
            attempts += 1
            if step == 1:
                place = "from the first row on" if self.last < 0 else f"after row {self.last}"
                self.ledger.damage(None, f"table messages is damaged {place} ({fault}); rows there are lost")
            if self.n_bytes > self.opened.size:
                break
            damaged = max(self.last, 0)
            self.last, step = self.first_readable(query, damaged, damaged + step), step * 2
        yield batch

    def take_next(self, query: str, batch: list[Row]) -> bool:
        """Fetch one row alone: Python's cursor reads a row ahead and loses the one before a damaged row."""
        with suppress(*FAULTS):
            row = self.connection.execute(query, (self.last, 1)).fetchone()
            if row is not None:
                self.take(row, batch)
                return True
        return False

    def take(self, row: Row, batch: list[Row]) -> None:
        """Append a row to the batch; one without a message gets an impossible time.

        Raises:
            sqlite3.DatabaseError: Rows repeat, as they do if pages refer to each other in a circle.
        """
        number, topic, time, content = row
        if isinstance(content, bytes | int) and isinstance(time, int) and isinstance(topic, int):
            self.n_bytes += content if isinstance(content, int) else len(content)
        else:
            row = (number, 0, NO_TIME, b"")
        if self.n_bytes > self.opened.size or number <= self.last:
            raise sqlite3.DatabaseError("rows repeat")
        self.last = number
        batch.append(row)

    def first_readable(self, query: str, damaged: int, beyond: int) -> int:
        """Return the lowest row after which SQLite can read again, between a damaged row and an upper bound."""
        while beyond - damaged > 1:
            middle = (damaged + beyond) // 2
            try:
                self.connection.execute(query, (middle, 1)).fetchone()
                beyond = middle
            except FAULTS:
                damaged = middle
        return beyond


def _listed(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


def _joined(batch: list[Row]) -> PageRows:
    """Convert rows to the arrays of a decoded page."""
    number, topic, time_ns = (np.array([row[i] for row in batch], np.int64) for i in range(3))
    contents = [row[3] if isinstance(row[3], bytes) else b"" for row in batch]
    length = np.array([len(content) for content in contents], np.int64)
    data = np.frombuffer(b"".join(contents), np.uint8)
    return PageRows(data, number, topic, time_ns, np.cumsum(length) - length, length)
