"""Reads ROS 2 bags stored in SQLite (`.db3`), whole or damaged.

Where a crash left a journal beside the file, both are copied to a temporary folder and SQLite rolls the copy
back; the user's file is never written.
"""

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.bounded_decompression import MAXIMUM_CHUNK_BYTES
from pipeline.logs.message_blocks import MAXIMUM_TIME_NS, MessageBlock, ReadingLedger, Topic
from pipeline.logs.message_definitions import full_type_name
from pipeline.logs.raw_log import Note, NoteKind

MAGIC = b"SQLite format 3\x00"
SIDE_FILES = ("-journal", "-wal", "-shm")
BATCH_ROWS = 4096
BATCH_BYTES = 1 << 23
ATTEMPTS_PAST_DAMAGE = 24
FAULTS = (sqlite3.Error, UnicodeDecodeError)  # the latter where SQLite's own message quotes damaged text
Row = tuple[int, int, int, bytes]  # row number, topic, time, message


def read_sqlite3(path: Path, ledger: ReadingLedger, wanted: Collection[str]) -> Iterator[MessageBlock]:
    """Yield the wanted topics' messages of one file in the order of recording.

    Raises:
        InputError: The file cannot be opened or is not a ROS 2 bag.
    """
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path}: not an SQLite file (its first bytes are not SQLite's); remove it")
        with _database(path, ledger) as connection:
            topics = _topics(connection, path)
            for topic in topics.values():
                ledger.add_topic(topic)
            for rows in _batches(connection, ledger, path.stat().st_size):
                yield from _blocks(rows, topics, ledger, wanted)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); check its permissions"
        ) from error
    except FAULTS as error:
        raise InputError(f"{path}: SQLite cannot read it ({error}); it is damaged from its start") from error


@contextmanager
def _database(path: Path, ledger: ReadingLedger) -> Iterator[sqlite3.Connection]:
    """Open the file so that nothing is written beside it."""
    side_files = [path.with_name(path.name + suffix) for suffix in SIDE_FILES]
    left = [side for side in side_files if side.exists() and side.stat().st_size]
    with tempfile.TemporaryDirectory() as folder:
        if left:
            opened = Path(folder) / path.name
            for source in (path, *left):
                shutil.copyfile(source, opened.with_name(source.name))
            names = ", ".join(side.name for side in left)
            text = f"{path.name}: a crash left {names}; SQLite rolled a copy back"
            ledger.notes.append(Note(NoteKind.attention, text))
            address = opened.as_uri()
        else:
            address = f"{path.resolve().as_uri()}?immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as connection:
            connection.text_factory = lambda text: text.decode(errors="replace")
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAXIMUM_CHUNK_BYTES)
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("PRAGMA cell_size_check = ON")
            yield connection


def _topics(connection: sqlite3.Connection, path: Path) -> dict[int, Topic]:
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"topics", "messages"} <= tables:
        found = ", ".join(sorted(map(str, tables))) or "none"
        raise InputError(f"{path}: an SQLite file, but not a ROS 2 bag (tables: {found}); remove it")
    definitions: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        rows = connection.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        definitions = {str(name): (str(text or ""), str(encoding or "")) for name, encoding, text in rows}
    topics = {}
    for number, name, type_name, encoding in connection.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        text, text_format = definitions.get(str(type_name), ("", "ros2msg"))
        topics[number] = Topic(str(name), full_type_name(str(type_name)), str(encoding), text, text_format)
    return topics


def _batches(connection: sqlite3.Connection, ledger: ReadingLedger, file_size: int) -> Iterator[list[Row]]:
    """Yield rows in the order of recording; where a page is damaged, go on behind it."""
    batch: list[Row] = []
    last, n_bytes, total = -1 << 62, 0, 0
    step = 1
    for _ in range(ATTEMPTS_PAST_DAMAGE):
        try:
            cursor = connection.execute(
                "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY rowid",
                (last,),
            )
            for row in cursor:
                number, topic, time, message = row
                whole = isinstance(message, bytes) and isinstance(time, int) and isinstance(topic, int)
                if not whole or not 0 <= time <= MAXIMUM_TIME_NS:
                    ledger.damage(None, f"row {number} of table messages holds no message; it is lost")
                    continue
                total += len(message)
                if number <= last or total > file_size:
                    raise sqlite3.DatabaseError("rows repeat")
                last, step = number, 1
                batch.append(row)
                n_bytes += len(message)
                if len(batch) >= BATCH_ROWS or n_bytes >= BATCH_BYTES:
                    yield batch
                    batch, n_bytes = [], 0
            break
        except FAULTS as error:
            if step == 1:
                place = "from the first row on" if last < 0 else f"after row {last}"
                ledger.damage(None, f"table messages is damaged {place} ({error}); rows there are lost")
            if total > file_size:
                break
            last, step = max(last, 0) + step, step * 2
    yield batch


def _blocks(
    rows: list[Row], topics: dict[int, Topic], ledger: ReadingLedger, wanted: Collection[str]
) -> Iterator[MessageBlock]:
    by_topic: dict[int, list[Row]] = {}
    for row in rows:
        by_topic.setdefault(row[1], []).append(row)
    for number, own in by_topic.items():
        topic = topics.get(number)
        if topic is None:
            ledger.damage(None, f"{len(own)} messages belong to a topic that is not described", len(own))
            continue
        ledger.count(topic, len(own))
        if topic.name in wanted:
            length = np.array([len(row[3]) for row in own], dtype=np.int64)
            data = np.frombuffer(b"".join(row[3] for row in own), np.uint8)
            time_ns = np.array([row[2] for row in own], dtype=np.int64)
            yield MessageBlock(topic, time_ns, data, np.cumsum(length) - length, length)
