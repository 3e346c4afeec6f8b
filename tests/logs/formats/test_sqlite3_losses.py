"""SQLite bags: what is missing is told, and what only looks odd costs nothing."""

import shutil
import sqlite3
import time
from contextlib import closing

import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.sqlite3 import file as sqlite3_file
from pipeline.logs.formats.sqlite3.file import read_sqlite3
from pipeline.logs.ingest import ingest
from pipeline.logs.messages.message_blocks import ReadingLedger
from pipeline.logs.messages.raw_log import NoteKind
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import SQLITE, whole_log

SECTOR = 512
WANTED = ("/joint_states", "/joint_commands")


@pytest.fixture
def bag(tmp_path, machine):
    """A sound bag of six seconds, without metadata."""
    entries = foreign.messages(foreign.ROS2, make_session(machine, 6), machine.joint_names)
    (written,) = foreign.write_rosbag2(tmp_path / "written", entries).glob("*.db3")
    path = tmp_path / "logs" / "a.db3"
    path.parent.mkdir()
    shutil.move(written, path)
    return path


def change(path, *statements):
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


@pytest.fixture
def run(bag, machine, config, loop_tracker, tmp_path):
    def run():
        summary = ingest(machine, bag.parent, tmp_path / "tuples", config, loop_tracker)
        assert not summary.failures
        (report,) = summary.reports
        damage = [note for note in report.notes if note.kind is NoteKind.damage]
        return report.metrics["n_rows"], damage, [note.text for note in report.notes if not note.is_usual]

    return run


def counted(path, damaged=None):
    """Messages found in the file, and the notes, or the line that refuses it."""
    ledger = ReadingLedger(path)
    try:
        n = sum(len(block.start) for block in read_sqlite3(path, ledger, WANTED))
    except InputError as error:
        return 0, [error]
    return n, ledger.notes


def test_every_zeroed_sector_that_costs_messages_is_told(tmp_path):
    log = whole_log(SQLITE)
    path = log.write(tmp_path / "a")
    n_losing = 0
    for at in range(SECTOR, len(log.content), SECTOR):
        path.write_bytes(log.content[:at] + bytes(SECTOR) + log.content[at + SECTOR :])
        n, notes = counted(path)
        assert n == log.n_messages or notes, (
            f"{log.n_messages - n} messages are lost at byte {at}, and nothing is told"
        )
        n_losing += n < log.n_messages
    assert n_losing > 50


def test_missing_rows_are_told_with_their_numbers(bag, run):
    n_rows, _, _ = run()
    change(bag, "DELETE FROM messages WHERE id IN (1, 2, 50, 90)")
    assert run()[0] >= n_rows - 3
    (note,) = run()[1]
    assert note.count == 4
    assert note.text == "a.db3: row numbers are missing (1 to 2, 50, 90): 4 messages are lost or were deleted"


def test_the_index_tells_of_rows_missing_at_the_end(bag, run):
    """The table ends early, and the index of times still lists all rows."""
    with closing(sqlite3.connect(bag)) as connection:
        (n_all,) = connection.execute("SELECT count(*) FROM messages").fetchone()
    change(
        bag, "CREATE TABLE shorter (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    change(bag, "INSERT INTO shorter SELECT * FROM messages WHERE id <= 400")
    change(
        bag,
        "PRAGMA writable_schema = ON",
        "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = 'shorter') "
        "WHERE name = 'messages'",
    )
    assert n_all > 400
    n, (note,) = counted(bag)
    assert n == 400 and note.count == n_all - 400
    assert note.text == f"a.db3: its index of times lists {n_all} messages, and 400 were found"


def test_negative_times_are_one_note(bag, run):
    change(bag, "UPDATE messages SET timestamp = -timestamp WHERE id % 50 = 7")
    _, (note,), _ = run()
    assert (
        note.count > 5
        and f"{note.count} rows hold no message or an impossible time (rows 7, 57, 107, …)" in note.text
    )


def test_very_many_impossible_rows_take_little_time(bag):
    (n_before, notes) = counted(bag)
    assert not notes
    change(
        bag,
        "INSERT INTO messages (topic_id, timestamp, data) WITH RECURSIVE n(i) AS "
        "(SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 200000) SELECT 1, -i, x'00' FROM n",
    )
    begin = time.process_time()
    n, (note,) = counted(bag)
    assert n == n_before and note.count == 200_000 and time.process_time() - begin < 5


def test_two_rows_of_one_topic(bag, run):
    """A recorder that met the publisher again; the messages take turns."""
    before = run()
    change(
        bag,
        *(
            f"INSERT INTO topics SELECT {number} + 10, {', '.join(columns)} FROM topics WHERE id = {number}"
            for number in (1, 2)
            for columns in [columns_of(bag, "topics")[1:]]
        ),
        "UPDATE messages SET topic_id = topic_id + 10 WHERE id % 3 = 0",
    )
    assert run() == before


def test_a_type_without_messages(bag, run):
    before = run()
    columns = columns_of(bag, "topics")
    values = [{"id": "50", "type": "'std_msgs/msg/Float64MultiArray'"}.get(name, name) for name in columns]
    change(bag, f"INSERT INTO topics SELECT {', '.join(values)} FROM topics WHERE name = '/joint_commands'")
    assert run() == before


def test_a_bag_of_2018(bag, run):
    """The first releases had no column for the serialisation; it was always CDR."""
    before = run()
    change(bag, "ALTER TABLE topics DROP COLUMN serialization_format")
    assert run() == before


def test_a_file_that_a_reader_left_is_no_crash(bag, run, monkeypatch):
    """`-shm`, and an empty `-wal`: nothing is to be rolled back, and nothing is copied."""
    before = run()
    change(bag, "PRAGMA user_version = 7")
    monkeypatch.setattr(sqlite3_file.shutil, "copyfile", None)
    bag.with_name("a.db3-shm").write_bytes(bytes(32768))
    bag.with_name("a.db3-wal").write_bytes(b"")
    assert run() == before


def columns_of(path, table):
    with closing(sqlite3.connect(path)) as connection:
        return [name for _, name, *_ in connection.execute(f"PRAGMA table_info({table})")]
