"""SQLite's own files beside the bag, left by a writer that was killed."""

import json
import os
import signal
import sqlite3
import struct
import subprocess
import sys
from pathlib import Path

from tests.logs.damage.case import Damaged, case
from tests.logs.samples.whole_logs import (
    SQLITE,
    WholeLog,
)

WRITER = """
import json, os, signal, sqlite3, sys
path, mode, n_committed = sys.argv[1], sys.argv[2], int(sys.argv[3])
rows = json.load(sys.stdin)
connection = sqlite3.connect(path, isolation_level=None)
connection.execute(f"PRAGMA journal_mode = {mode}")
connection.execute("PRAGMA synchronous = FULL")
connection.execute("PRAGMA wal_autocheckpoint = 0")
connection.execute("PRAGMA cache_size = 2")
connection.execute("PRAGMA cache_spill = 2")
insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
def write(some):
    connection.execute("BEGIN")
    for topic, time, data in some:
        connection.execute(insert, (topic, time, bytes.fromhex(data)))
write(rows[:n_committed])
connection.execute("COMMIT")
write(rows[n_committed:])
if mode == "DELETE":
    connection.execute("UPDATE messages SET data = zeroblob(length(data))")
os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_writer(folder: Path, log: WholeLog, mode: str) -> tuple[Path, int]:
    """Write the log's later half by a process that is killed in a transaction; return how many rows were committed."""
    path = log.write(folder / "a")
    connection = sqlite3.connect(path)
    rows = [
        (topic, time, data.hex())
        for topic, time, data in connection.execute("SELECT topic_id, timestamp, data FROM messages")
    ]
    n_before, n_committed = len(rows) // 2, len(rows) // 4
    connection.execute(
        "DELETE FROM messages WHERE id > (SELECT id FROM messages LIMIT 1 OFFSET ?)", (n_before - 1,)
    )
    connection.commit()
    connection.execute("VACUUM")
    connection.close()
    result = subprocess.run(
        [sys.executable, "-c", WRITER, str(path), mode, str(n_committed)],
        input=json.dumps(rows[n_before:]),
        text=True,
        check=False,
    )
    assert result.returncode == -signal.SIGKILL
    return path, n_before + n_committed


def assert_hot(path: Path) -> None:
    """The journal has its mark and a synced count of pages, and pages of the file are not those of the last commit."""
    journal = path.with_name(path.name + "-journal").read_bytes()
    mark, n_pages = struct.unpack_from(">8sI", journal)
    assert mark == bytes.fromhex("d9d505f920a163d7") and n_pages > 0
    unsafe = sqlite3.connect(f"{path.as_uri()}?immutable=1", uri=True)  # without the journal
    (zeroed,) = unsafe.execute("SELECT count(*) FROM messages WHERE data = zeroblob(length(data))").fetchone()
    unsafe.close()
    assert zeroed > 0


@case("hot journal of a killed writer", SQLITE)
def hot_journal(folder: Path, log: WholeLog) -> Damaged:
    """Committed rows are overwritten in the file; the journal holds what they were."""
    path, n_committed = killed_writer(folder, log, "DELETE")
    assert_hot(path)
    return Damaged(path, n_committed, (r"a\.db3: a crash left a\.db3-journal",), n_whole=n_committed)


@case("write-ahead log of a killed writer", SQLITE)
def write_ahead_log(folder: Path, log: WholeLog) -> Damaged:
    """A quarter of the rows was committed and stands in the write-ahead log only."""
    path, n_committed = killed_writer(folder, log, "WAL")
    assert (folder / "a.db3-wal").stat().st_size > 100_000 // 4
    return Damaged(path, n_committed, (r"a\.db3: a crash left a\.db3-wal",), n_whole=n_committed)


@case("write-ahead log, cut off", SQLITE)
def cut_write_ahead_log(folder: Path, log: WholeLog) -> Damaged:
    """Its commit mark is lost, so SQLite counts none of it; what the file itself holds stays."""
    path, _ = killed_writer(folder, log, "WAL")
    side = folder / "a.db3-wal"
    os.truncate(side, 10_000)
    n_whole, said = log.n_messages // 2 + log.n_messages // 4, r"a\.db3: a crash left a\.db3-wal"
    return Damaged(path, log.n_messages // 2, (said,), n_whole=n_whole)
