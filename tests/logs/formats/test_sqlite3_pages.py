"""Reading SQLite's pages as arrays gives what SQLite gives row by row, on any file."""

import itertools
import sqlite3

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.logs.formats.sqlite3 import file as sqlite3_file
from pipeline.logs.formats.sqlite3.file import read_sqlite3
from pipeline.logs.formats.sqlite3.pages import LEAST_CELL_BYTES, UnusualError
from pipeline.logs.messages.message_blocks import ReadingLedger
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

TOPICS = ("/one", "/two", "/camera")
WANTED = {"/one", "/two"}
generated = settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def write(path, rows, page_size=512, schema="id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "):
    """A file as `ros2 bag record` writes it, by SQLite."""
    connection = sqlite3.connect(":memory:")
    connection.execute(f"PRAGMA page_size = {page_size}")
    connection.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    connection.execute(f"CREATE TABLE messages ({schema}timestamp INTEGER NOT NULL, data BLOB NOT NULL)")
    connection.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    for number, topic in enumerate(TOPICS):
        connection.execute("INSERT INTO topics VALUES (?, ?, 'a/msg/A', 'cdr')", (number, topic))
    connection.executemany("INSERT INTO messages (id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows)
    connection.commit()
    path.write_bytes(connection.serialize())
    connection.close()
    return path


def found(path):
    ledger = ReadingLedger(path)
    try:
        messages = [
            (block.topic.name, time_ns, block.data[start : start + length].tobytes())
            for block in read_sqlite3(path, ledger, WANTED)
            for time_ns, start, length in zip(
                block.log_time_ns.tolist(), block.start.tolist(), block.length.tolist(), strict=True
            )
        ]
    except InputError as error:
        return str(error)
    by_topic = {topic: [message for message in messages if message[0] == topic] for topic in TOPICS}
    return by_topic, ledger.counts, ledger.notes


def found_by_sqlite(path):
    def refuse(*_):
        raise UnusualError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3_file, "rows_in_pages", refuse)
        return found(path)


@st.composite
def tables(draw):
    numbers = sorted(draw(st.sets(st.integers(1, 1 << draw(st.sampled_from([8, 20, 33]))), max_size=60)))
    times = st.one_of(st.integers(0, 300), st.integers(0, 1 << 50), st.integers(1 << 60, 1 << 62))
    # As CDR, they begin with a zero byte; what begins as zstd does is taken for a compressed message.
    content = st.builds(
        lambda piece, n: bytes(1) + piece * n, st.binary(max_size=90), st.sampled_from([1, 1, 9])
    )
    rows = [(number, draw(st.integers(0, 2)), draw(times), draw(content)) for number in numbers]
    return rows, draw(st.sampled_from([512, 1024, 4096]))


@generated
@given(table=tables())
def test_pages_give_what_was_written(tmp_path, table):
    rows, page_size = table
    path = write(tmp_path / "a.db3", rows, page_size)
    messages, counts, notes = found(path)
    numbers = [0, *(row[0] for row in rows)]
    gaps = [later - before - 1 for before, later in itertools.pairwise(numbers)]
    n_missing = sum(gap for gap in gaps if gap <= path.stat().st_size // LEAST_CELL_BYTES)
    assert [note.count for note in notes] == ([n_missing] if n_missing else [])
    for number, topic in enumerate(TOPICS):
        own = [(topic, row[2], row[3]) for row in rows if row[1] == number]
        assert counts[topic] == len(own)
        assert messages[topic] == (own if topic in WANTED else [])


@generated
@given(table=tables(), data=st.data())
def test_damaged_pages_give_what_sqlite_gives(tmp_path, table, data):
    path = write(tmp_path / "a.db3", *table)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(100, len(content) - 1))
        content[at] = data.draw(st.sampled_from([content[at] ^ (1 << data.draw(st.integers(0, 7))), 0, 255]))
    path.write_bytes(content)
    assert found(path) == found_by_sqlite(path)


def test_pages_are_used(tmp_path, machine, monkeypatch):
    session = make_session(machine, seconds=100)
    folder = foreign.write_rosbag2(
        tmp_path / "a", foreign.messages(foreign.ROS2, session, machine.joint_names)
    )
    (path,) = folder.glob("*.db3")
    monkeypatch.setattr(sqlite3_file._Messages, "batches", None)
    blocks = list(read_sqlite3(path, ReadingLedger(path), {"/joint_states", "/joint_commands"}))
    assert sum(len(block.start) for block in blocks) == len(session.q) + len(session.command)


@pytest.mark.parametrize("size", [60_000, 6_000_000])
def test_large_messages_of_a_wanted_topic(tmp_path, size):
    """They spill into further pages, which SQLite reads."""
    rows = [
        (1, 0, 5, b"small"),
        (2, 0, 6, bytes(size)),
        (3, 2, 7, bytes(2 * size)),
        (4, 1, 8, b"\x00" * size + b"end"),
    ]
    messages, counts, notes = found(write(tmp_path / "a.db3", rows, 4096))
    assert [len(message[2]) for message in messages["/one"]] == [5, size]
    assert messages["/two"][0][2].endswith(b"end") and counts["/camera"] == 1 and not notes


def test_other_columns_are_read_by_sqlite(tmp_path):
    schema = "extra TEXT, id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
    path = write(tmp_path / "a.db3", [(1, 0, 5, b"one"), (2, 1, 6, b"two")], schema=schema)
    messages, _, notes = found(path)
    assert (
        messages["/one"] == [("/one", 5, b"one")] and messages["/two"] == [("/two", 6, b"two")] and not notes
    )


@pytest.mark.parametrize("share", [0.5, 0.613, 0.7, 0.777, 0.9, 0.943])
def test_file_that_was_cut_off(tmp_path, share):
    """A copy that was interrupted: SQLite itself would refuse it as a whole."""
    rows = [(number, number % 2, 10 * number, b"%d" % number * 20) for number in range(1, 3000)]
    path = write(tmp_path / "a.db3", rows, 4096)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    messages, counts, notes = found(path)
    for number, topic in enumerate(TOPICS[:2]):
        own = [(topic, row[2], row[3]) for row in rows if row[1] == number]
        # In the half page at its end, later rows stand before earlier ones: some may be whole behind lost ones.
        places = [own.index(message) for message in messages[topic]]
        n_before_gap = sum(place == index for index, place in enumerate(places))
        assert places == sorted(set(places)) and len(places) - n_before_gap < 40
        assert 0.7 * share * len(own) < len(messages[topic]) == counts[topic] < len(own)
    assert "after row" in notes[0].text and "lost" in notes[0].text
