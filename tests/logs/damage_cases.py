"""The list of damaged, odd and hostile logs: how each is made, and what must come of it.

A case is a builder that makes the log in an empty folder. It returns what is to be read and what is known of it from
how it was made: how many messages must be recovered at least, what the line must say, whether the log is usable.
"""

import bz2
import enum
import io
import json
import os
import signal
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import lz4.block
import polars

from tests.logs import foreign_bags as foreign
from tests.logs.whole_logs import (
    BAGS,
    MCAP,
    MCAP_CHUNKED,
    MCAP_UNCHECKED,
    MCAP_UNCHUNKED,
    ROS1,
    ROW_GROUP,
    SQLITE,
    TABLES,
    Chunk,
    WholeLog,
    entries_of,
    whole_log,
    write_table,
)

SPARSE_BYTES = 10 << 30
BOMB_BYTES = 1 << 31
REFUSED = 2  # exit status
SQLITE_PAGE = 4096
EVERY_KIND = (*BAGS, *TABLES)


class Where(enum.Enum):
    """What a case needs around it."""

    here = "in this process"
    fused = "in a process of its own, whose memory is measured and limited"
    unprivileged = "in a process that permissions bind, even where the tests run as root"
    full_disk = "with files that may not grow"


@dataclass(frozen=True)
class Damaged:
    """A damaged log and what must come of it.

    Attributes:
        path: What is read: a file or a folder.
        at_least: Messages that must be recovered.
        says: Regular expressions that the lines given must match, each at least one of them.
        status: 0 where the log is usable, `REFUSED` where it is not.
        may_differ: Messages whose values may be others than recorded, where the format carries no checksum.
        n_whole: Messages before the damage, where it is another number than the whole log's.
    """

    path: Path
    at_least: int
    says: tuple[str, ...] = ()
    status: int = 0
    may_differ: int = 0
    n_whole: int | None = None


Builder = Callable[[Path, WholeLog], Damaged]


@dataclass(frozen=True)
class DamageCase:
    """One case: a kind of damage to one kind of log."""

    name: str
    kind: str
    builder: Builder
    where: Where
    only_read: bool  # not hashed too, which takes its time with ten gigabytes

    def build(self, folder: Path) -> Damaged:
        """Make the log in an empty folder."""
        return self.builder(folder, whole_log(self.kind))

    def __str__(self) -> str:
        return f"{self.name} ({self.kind})"


CASES: list[DamageCase] = []


def case(
    name: str, *kinds: str, where: Where = Where.here, only_read: bool = False
) -> Callable[[Builder], Builder]:
    """Put a builder on the list, once for each kind of log."""

    def register(builder: Builder) -> Builder:
        CASES.extend(DamageCase(name, kind, builder, where, only_read) for kind in kinds)
        return builder

    return register


def at_byte(offset: int) -> str:
    return rf"byte {offset}\b"


def flipped(content: bytes, at: int, bit: int = 4) -> bytes:
    damaged = bytearray(content)
    damaged[at] ^= 1 << bit
    return bytes(damaged)


def replaced(content: bytes, old: bytes, new: bytes) -> bytes:
    assert content.count(old) >= 1 and len(old) == len(new)
    return content.replace(old, new)


def refused(path: Path, *says: str) -> Damaged:
    return Damaged(path, 0, (path.name.replace(".", r"\."), *says), REFUSED)


def all_but(log: WholeLog, path: Path, chunk: Chunk) -> Damaged:
    """All messages but those of one chunk, whose place is told."""
    return Damaged(path, log.n_messages - chunk.n_messages, (f"{path.name}, {at_byte(chunk.start)}",))


# --- The recorder crashed, or the file was cut off


@case("cut off: no index", *ROS1, *MCAP)
def no_index(folder: Path, log: WholeLog) -> Damaged:
    """Everything up to the last message is there."""
    end = log.chunks[-1].end if log.chunks else log.ends[-1]
    return Damaged(log.write(folder / "a", log.content[:end]), log.n_messages)


@case("cut off in the middle of a chunk", *ROS1, *MCAP_CHUNKED, MCAP_UNCHECKED)
def half_a_chunk(folder: Path, log: WholeLog) -> Damaged:
    chunk = log.chunks[-1]
    cut = (chunk.data + chunk.end) // 2
    path = log.write(folder / "a", log.content[:cut])
    return Damaged(path, log.n_before(cut), (f"{path.name}, {at_byte(chunk.start)}",))


@case("cut off in the middle of a message", "ROS 1", "MCAP", MCAP_UNCHUNKED, MCAP_UNCHECKED)
def half_a_message(folder: Path, log: WholeLog) -> Damaged:
    number = int(0.8 * log.n_messages)
    cut = (log.ends[number - 1] + log.ends[number]) // 2
    path = log.write(folder / "a", log.content[:cut])
    return Damaged(path, number, (f"{path.name}, byte",))


@case("cut off in the index", *ROS1, *MCAP)
def half_an_index(folder: Path, log: WholeLog) -> Damaged:
    cut = (log.ends[-1] + len(log.content)) // 2
    return Damaged(log.write(folder / "a", log.content[:cut]), log.n_messages)


@case("killed recorder, `.bag.active`", *ROS1)
def active_bag(folder: Path, log: WholeLog) -> Damaged:
    """The open chunk's header says nothing of its length yet, the bag's header nothing of an index."""
    chunk = log.chunks[-1]
    cut = (chunk.data + chunk.end) // 2
    content = bytearray(log.content[:cut])
    size_at = content.index(b"size=", chunk.start) + len(b"size=")
    content[size_at : size_at + 4] = content[chunk.data - 4 : chunk.data] = bytes(4)
    index_at = content.index(b"index_pos=") + len(b"index_pos=")
    content[index_at : index_at + 8] = bytes(8)
    path = folder / "a.bag.active"
    path.write_bytes(content)
    return Damaged(path, log.n_before(cut), (rf"byte ({chunk.start}|{chunk.data})\b",))


@case("killed recorder, no end mark", "MCAP", "MCAP, lz4", "MCAP, zstd", MCAP_UNCHUNKED)
def unfinished_mcap(folder: Path, log: WholeLog) -> Damaged:
    """The `mcap` library without its last call: the chunk that it gathers in memory was never written."""
    compression = log.kind.partition(", ")[2] or "none"
    path = foreign.write_mcap(
        folder / "a.mcap", entries_of(foreign.ROS2), compression, bool(log.chunks), finish=False
    )
    n_lost = log.chunks[-1].n_messages if log.chunks else 0
    return Damaged(path, log.n_messages - n_lost, (r"a\.mcap, byte \d+: .*end",))


@case("cut off after two thirds", SQLITE)
def cut_database(folder: Path, log: WholeLog) -> Damaged:
    cut = 2 * len(log.content) // 3
    return Damaged(log.write(folder / "a", log.content[:cut]), log.n_before(cut), (r"a\.db3.*row \d+",))


@case("cut off in the middle of a row", "CSV")
def half_a_row(folder: Path, log: WholeLog) -> Damaged:
    """The cut row has its time and some positions, no command."""
    row = log.content.rindex(b"\n", 0, 2 * len(log.content) // 3) + 1
    cut = log.content.index(b",", log.content.index(b",", row) + 1)
    return Damaged(log.write(folder / "a", log.content[:cut]), log.n_before(row), may_differ=1)


@case("cut off before its footer", "Parquet")
def no_footer(folder: Path, log: WholeLog) -> Damaged:
    """Columns and their places stand in the footer only."""
    return refused(log.write(folder / "a", log.content[: 9 * len(log.content) // 10]))


@case("cut off after its first bytes", *EVERY_KIND)
def only_a_head(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", log.content[:50]))


# --- Single bits


@case("bit flip in a chunk", "ROS 1, bz2", *MCAP_CHUNKED)
def flip_in_a_checked_chunk(folder: Path, log: WholeLog) -> Damaged:
    """Checksums tell; the chunk is lost, and nothing else."""
    chunk = log.chunks[len(log.chunks) // 2]
    path = log.write(folder / "a", flipped(log.content, (chunk.data + chunk.end) // 2))
    return all_but(log, path, chunk)


@case("bit flip in a number", "ROS 1", MCAP_UNCHUNKED, MCAP_UNCHECKED, SQLITE)
def flip_in_a_number(folder: Path, log: WholeLog) -> Damaged:
    """Nothing in the format tells: one value is another."""
    value = log.session.q[len(log.session.q) // 2].tobytes()
    path = log.write(folder / "a", flipped(log.content, log.content.index(value) + 2))
    return Damaged(path, log.n_messages, may_differ=1)


@case("bit flip in a chunk", "ROS 1, lz4")
def flip_in_an_unchecked_chunk(folder: Path, log: WholeLog) -> Damaged:
    """The recorder's lz4 carries no checksum: what cannot be unpacked is lost, what can may be wrong."""
    chunk = log.chunks[3]
    path = log.write(folder / "a", flipped(log.content, (chunk.data + chunk.end) // 2))
    return Damaged(path, log.n_messages - chunk.n_messages, may_differ=chunk.n_messages)


@case("bit flip in a message's length", "ROS 1", MCAP_UNCHUNKED)
def flip_in_a_length(folder: Path, log: WholeLog) -> Damaged:
    """The message's end, and so the place of the next one, is lost; the rest of the chunk goes with it."""
    number = log.n_messages // 2
    message = log.ends[number - 1]
    if log.kind == "ROS 1":
        (header_length,) = struct.unpack_from("<I", log.content, message)
        length_at = message + 4 + header_length + 2
        chunk = next(chunk for chunk in log.chunks if chunk.start < message < chunk.end)
        n_lost, place = log.n_before(chunk.end) - number, at_byte(chunk.start)
    else:
        length_at, n_lost, place = message + 3, log.n_messages - number, "byte"
    path = log.write(folder / "a", flipped(log.content, length_at))
    return Damaged(path, log.n_messages - n_lost, (f"{path.name}.*{place}",))


@case("bit flip in the index", "ROS 1", *MCAP)
def flip_in_the_index(folder: Path, log: WholeLog) -> Damaged:
    """The index between chunks: entries that point elsewhere."""
    if log.kind == MCAP_UNCHUNKED:
        index = log.first(11)  # statistics: this file has no other index
    else:
        index = log.first(7 if log.kind in MCAP else 4, after=log.chunks[0].end)
    path = log.write(folder / "a", flipped(log.content, index.end - 9, bit=1))
    return Damaged(path, log.n_messages)


@case("index overwritten", *ROS1, *MCAP)
def no_usable_index(folder: Path, log: WholeLog) -> Damaged:
    """All after the last message is 0xff."""
    end = log.chunks[-1].end if log.chunks else log.ends[-1]
    path = log.write(folder / "a", log.content[:end] + b"\xff" * (len(log.content) - end))
    return Damaged(path, log.n_messages)


@case("index page overwritten", SQLITE)
def index_page(folder: Path, log: WholeLog) -> Damaged:
    """The index by time is not needed; it lies where the `timestamp_idx` of the schema says."""
    path = log.write(folder / "a")
    connection = sqlite3.connect(path)
    ((page,),) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'")
    connection.close()
    damaged = bytearray(log.content)
    damaged[(page - 1) * SQLITE_PAGE : page * SQLITE_PAGE] = b"\xff" * SQLITE_PAGE
    path.write_bytes(damaged)
    return Damaged(path, log.n_messages)


@case("page of messages overwritten", SQLITE)
def message_page(folder: Path, log: WholeLog) -> Damaged:
    end = log.ends[log.n_messages // 2]
    damaged = bytearray(log.content)
    damaged[end - SQLITE_PAGE : end] = b"\xff" * SQLITE_PAGE
    path = log.write(folder / "a", bytes(damaged))
    return Damaged(path, log.n_messages - log.ends.count(end), (r"a\.db3: .*after row \d+",))


@case("root page of the messages overwritten", SQLITE)
def root_page(folder: Path, log: WholeLog) -> Damaged:
    """The tree's top is gone, and with it the way to its leaves."""
    path = log.write(folder / "a")
    connection = sqlite3.connect(path)
    ((page,),) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
    connection.close()
    damaged = bytearray(log.content)
    damaged[(page - 1) * SQLITE_PAGE : page * SQLITE_PAGE] = b"\xff" * SQLITE_PAGE
    path.write_bytes(damaged)
    return refused(path, "table messages is damaged from the first row on")


@case("bit flip in the footer", *MCAP, "Parquet")
def flip_in_the_footer(folder: Path, log: WholeLog) -> Damaged:
    if log.kind == "Parquet":
        return refused(log.write(folder / "a", flipped(log.content, len(log.content) - 6)))
    footer = log.first(2)
    return Damaged(log.write(folder / "a", flipped(log.content, footer.body + 3)), log.n_messages)


@case("bit flip in the header", *ROS1, *MCAP)
def flip_in_the_header(folder: Path, log: WholeLog) -> Damaged:
    """The header record's length: the next record is not where it says."""
    at = len(b"#ROSBAG V2.0\n") + 1 if log.kind in ROS1 else 8 + 3
    path = log.write(folder / "a", flipped(log.content, at))
    if log.kind == MCAP_UNCHUNKED:  # nothing tells where the next record begins
        return refused(path, at_byte(8))
    return Damaged(path, log.n_messages, (rf"{path.name}, byte (8|13)\b",))


@case("bit flip in a chunk's header", *ROS1, *MCAP_CHUNKED)
def flip_in_a_chunk_header(folder: Path, log: WholeLog) -> Damaged:
    """The name of the compression."""
    chunk = log.chunks[2]
    name = (log.kind.partition(", ")[2] or "none").encode()
    length_of_name = chunk.start + 9 + 28  # of an MCAP chunk without compression, which has no name
    at = length_of_name if log.kind == "MCAP" else log.content.index(name, chunk.start)
    return all_but(log, log.write(folder / "a", flipped(log.content, at)), chunk)


@case("record head overwritten", *ROS1, *MCAP_CHUNKED)
def record_head(folder: Path, log: WholeLog) -> Damaged:
    """No record stands where a chunk should: reading goes on at the next one that the file's index names."""
    chunk = log.chunks[1]
    damaged = bytearray(log.content)
    damaged[chunk.start : chunk.start + 9] = b"\xee" * 9
    return all_but(log, log.write(folder / "a", bytes(damaged)), chunk)


@case("first chunk lost, which describes the topics", *ROS1, *MCAP_CHUNKED)
def first_chunk(folder: Path, log: WholeLog) -> Damaged:
    """The descriptions are repeated at the file's end."""
    chunk = log.chunks[0]
    damaged = bytearray(log.content)
    damaged[chunk.start : chunk.start + 60] = b"\xee" * 60
    return all_but(log, log.write(folder / "a", bytes(damaged)), chunk)


@case("bit flip in the header", SQLITE, "CSV", "Parquet")
def flip_in_a_file_header(folder: Path, log: WholeLog) -> Damaged:
    """The page size; the name of a column; the magic bytes, which a Parquet file repeats at its end."""
    at = {SQLITE: 16, "CSV": log.content.find(b"q_swing"), "Parquet": 1}[log.kind]
    path = log.write(folder / "a", flipped(log.content, at, bit=1))
    if log.kind == "Parquet":
        return Damaged(path, log.n_messages)
    return refused(path, "SQLite" if log.kind == SQLITE else "column q_swing is missing.*columns seen")


@case("bit flip in a row", "CSV")
def flip_in_a_row(folder: Path, log: WholeLog) -> Damaged:
    """A digit becomes a letter: the row lacks a number."""
    row = log.content.index(b"\n", len(log.content) // 2) + 1
    at = log.content.index(b",", row) + 2
    return Damaged(log.write(folder / "a", flipped(log.content, at, bit=6)), log.n_messages - 2, may_differ=1)


@case("bit flip in a row group", "Parquet")
def flip_in_a_row_group(folder: Path, log: WholeLog) -> Damaged:
    """The writer's pages carry no checksum: what cannot be unpacked is lost, what can may be wrong."""
    path = log.write(folder / "a", flipped(log.content, len(log.content) // 2))
    return Damaged(path, log.n_messages - 2 * ROW_GROUP, may_differ=2 * ROW_GROUP)


@case("bytes of a row group overwritten", "Parquet")
def damaged_row_group(folder: Path, log: WholeLog) -> Damaged:
    """Two row groups of 100 rows at most; as much again for finding out which rows they hold."""
    at = len(log.content) // 2
    path = log.write(folder / "a", log.content[:at] + b"\xff" * 2000 + log.content[at + 2000 :])
    return Damaged(path, log.n_messages - 2 * 3 * ROW_GROUP, (r"a\.parquet",))


@case("chunk that declares 2^60 bytes", *MCAP_CHUNKED)
def immense_chunk(folder: Path, log: WholeLog) -> Damaged:
    chunk = log.chunks[0]
    damaged = bytearray(log.content)
    damaged[chunk.start + 9 + 16 : chunk.start + 9 + 24] = (1 << 60).to_bytes(8, "little")
    path = log.write(folder / "a", bytes(damaged))
    return all_but(log, path, chunk)


# --- Nothing in it, or not what is wanted


@case("empty file", *ROS1[:1], "MCAP", SQLITE, *TABLES)
def empty_file(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b""))


@case("a file that is no log", "ROS 1", "MCAP", SQLITE, *TABLES)
def no_log(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b"this is no log, whatever its name says\n" * 9))


@case("a `.bag.active` that is no log", "ROS 1")
def no_active_log(folder: Path, log: WholeLog) -> Damaged:
    path = folder / "a.bag.active"
    path.write_bytes(bytes(5000))
    return refused(path)


@case("random bytes", "ROS 1", "MCAP", SQLITE, *TABLES)
def random_bytes(folder: Path, log: WholeLog) -> Damaged:
    """Behind the format's own first bytes, where it has any."""
    head = {"ROS 1": 13, "MCAP": 8, SQLITE: 16, "CSV": 0, "Parquet": 4}[log.kind]
    noise = bytes((i * i * 7919 + i // 3) % 251 for i in range(20_000))
    return refused(log.write(folder / "a", log.content[:head] + noise))


def _write_bag(folder: Path, log: WholeLog, entries: list[tuple[int, str, object]]) -> Path:
    if log.kind in ROS1:
        return foreign.write_rosbag1(folder / "a.bag", entries)
    if log.kind in MCAP:
        return foreign.write_mcap(folder / "a.mcap", entries)
    return foreign.write_rosbag2(folder / "a", entries)


def _entries(log: WholeLog) -> list[tuple[int, str, object]]:
    return entries_of(foreign.ROS1 if log.kind in ROS1 else foreign.ROS2)


@case("no messages", "ROS 1", "MCAP", SQLITE)
def no_messages(folder: Path, log: WholeLog) -> Damaged:
    return refused(_write_bag(folder, log, []), "topic /joint_states is not in the log.*seen: none")


@case("no rows", *TABLES)
def no_rows(folder: Path, log: WholeLog) -> Damaged:
    return refused(write_table(folder / f"a{log.suffix}", n_rows=0), "no row holds a time and positions")


@case("no command topic", "ROS 1", "MCAP", SQLITE)
def no_command_topic(folder: Path, log: WholeLog) -> Damaged:
    entries = [entry for entry in _entries(log) if entry[1] != "/joint_commands"]
    said = r"commands: topic /joint_commands is not in the log.*/joint_states \(sensor_msgs/msg/JointState"
    return refused(_write_bag(folder, log, entries), said)


@case("no joint-state topic", "ROS 1", "MCAP", SQLITE)
def no_joint_topic(folder: Path, log: WholeLog) -> Damaged:
    entries = [entry for entry in _entries(log) if entry[1] != "/joint_states"]
    said = r"joint states: topic /joint_states is not in the log.*/joint_commands \(std_msgs/msg/Int8Multi"
    return refused(_write_bag(folder, log, entries), said)


@case("command topic of another type", "ROS 1", "MCAP", SQLITE)
def wrong_type(folder: Path, log: WholeLog) -> Damaged:
    store = foreign.ROS1 if log.kind in ROS1 else foreign.ROS2
    entries = [
        (time, topic, foreign.joy(store, time, [0.0] * 4) if topic == "/joint_commands" else message)
        for time, topic, message in _entries(log)
    ]
    said = "/joint_commands can be used: they are sensor_msgs/msg/Joy, not an array; set commands.source"
    return refused(_write_bag(folder, log, entries), said)


@case("no column of commands", *TABLES)
def no_command_column(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    frame = polars.read_csv(path) if log.kind == "CSV" else polars.read_parquet(path)
    frame = frame.drop("a_arm")
    frame.write_csv(path) if log.kind == "CSV" else frame.write_parquet(path)
    return refused(path, "column a_arm is missing; map it in conf/machine/.*columns seen: t, q_swing")


@case("words where numbers should be", *TABLES)
def words(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    frame = polars.read_csv(path) if log.kind == "CSV" else polars.read_parquet(path)
    frame = frame.with_columns(polars.lit("word").alias("t"))
    frame.write_csv(path) if log.kind == "CSV" else frame.write_parquet(path)
    return refused(path, "no row holds a time and positions; check the column map")


# --- SQLite's own files beside the bag, left by a writer that was killed

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


# --- Bag folders


def split_bag(folder: Path, log: WholeLog, metadata: str = "") -> tuple[Path, list[int]]:
    """A bag of three files; return the messages of each."""
    entries = entries_of(foreign.ROS2)
    bag = folder / "run"
    bag.mkdir()
    third = len(entries) // 3
    counts = []
    for number in range(3):
        part = entries[number * third : (number + 1) * third if number < 2 else None]
        if log.kind == SQLITE:
            (file,) = foreign.write_rosbag2(folder / f"part{number}", part).glob("*.db3")
            file.rename(bag / f"run_{number}.db3")
            for rest in (folder / f"part{number}").iterdir():
                rest.unlink()
            (folder / f"part{number}").rmdir()
        else:
            foreign.write_mcap(bag / f"run_{number}.mcap", part)
        counts.append(len(part))
    files = ", ".join(f"run_{number}{log.suffix}" for number in range(3))
    text = metadata or f"rosbag2_bagfile_information: {{relative_file_paths: [{files}]}}\n"
    (bag / "metadata.yaml").write_text(text)
    return bag, counts


@case("damaged metadata.yaml", "MCAP, zstd", SQLITE)
def damaged_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log, "rosbag2_bagfile_information: [\x00\n\t- {")
    return Damaged(bag, sum(counts))


@case("empty metadata.yaml", "MCAP, zstd", SQLITE)
def empty_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / "metadata.yaml").write_bytes(b"")  # as a crash leaves it
    return Damaged(bag, sum(counts))


@case("metadata.yaml of another structure", "MCAP, zstd")
def odd_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log, "rosbag2_bagfile_information: [{relative_file_paths: 3}]")
    return Damaged(bag, sum(counts))


@case("file of a split bag missing", "MCAP, zstd", SQLITE)
def missing_part(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    name = f"run_1{log.suffix}"
    (bag / name).unlink()
    return Damaged(bag, counts[0] + counts[2], (f"run: file {name} is listed .* missing",))


@case("empty last file of a split bag", "MCAP, zstd", SQLITE)
def empty_part(folder: Path, log: WholeLog) -> Damaged:
    """The recorder was killed just after it began a new file."""
    bag, counts = split_bag(folder, log)
    (bag / f"run_2{log.suffix}").write_bytes(b"")
    return Damaged(bag, counts[0] + counts[1], (f"run_2{log.suffix}",))


@case("damaged file of a split bag", "MCAP, zstd", SQLITE)
def damaged_part(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / f"run_1{log.suffix}").write_bytes(b"\xff" * 5000)
    return Damaged(bag, counts[0] + counts[2], (f"run_1{log.suffix}",))


@case("bag folder without files", "MCAP, zstd")
def no_parts(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    for number in range(3):
        (bag / f"run_{number}.mcap").unlink()
    return refused(bag, "without its files")


# --- Permissions, disks, odd files


@case("no permission to read the file", "ROS 1", "MCAP", SQLITE, *TABLES, where=Where.unprivileged)
def unreadable_file(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    path.chmod(0)
    return refused(path, r"cannot be read \(Permission denied\); check")


@case("no permission to list the folder", "MCAP, zstd", where=Where.unprivileged)
def unreadable_folder(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    bag.chmod(0)
    return refused(bag, "Permission denied")


@case("no permission to enter the folder", "MCAP, zstd", SQLITE, where=Where.unprivileged)
def locked_folder(folder: Path, log: WholeLog) -> Damaged:
    """It can be listed, and nothing in it opened."""
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").unlink()
    bag.chmod(0o444)
    return refused(bag, "Permission denied")


@case("no permission to read metadata.yaml", "MCAP, zstd", where=Where.unprivileged)
def unreadable_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").chmod(0)
    return refused(bag, "metadata.yaml: cannot be read")


@case("output folder not writable", "MCAP, zstd", where=Where.unprivileged)
def locked_output(folder: Path, log: WholeLog) -> Damaged:
    output = folder / "output"
    output.mkdir()
    output.chmod(0o555)
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"output.*cannot be (written|made) \(Permission denied\)",), REFUSED)


@case("output is a file", "MCAP, zstd")
def output_is_a_file(folder: Path, log: WholeLog) -> Damaged:
    (folder / "output").write_text("in the way")
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"output: cannot be made \(File exists\)",), REFUSED)


@case("full disk", "MCAP, zstd", SQLITE, "CSV", where=Where.full_disk)
def full_disk(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"cannot be written .*make room",), REFUSED)


@case("symbolic link to itself", "MCAP")
def link_to_itself(folder: Path, log: WholeLog) -> Damaged:
    """Beside a good log, which must be read."""
    logs = folder / "logs"
    logs.mkdir()
    log.write(logs / "good")
    (logs / "a.mcap").symlink_to("a.mcap")
    return Damaged(logs, log.n_messages, (r"a\.mcap",), REFUSED)


@case("folders that link to each other", "MCAP")
def loops_of_links(folder: Path, log: WholeLog) -> Damaged:
    """Eight folders with a link to every other: a hundred thousand ways through them."""
    logs = folder / "logs"
    folders = [logs / f"folder{number}" for number in range(8)]
    for one in folders:
        one.mkdir(parents=True)
        for other in folders:
            (one / other.name).symlink_to(other)
    log.write(folders[0] / "good")
    return Damaged(logs, log.n_messages)


@case("named pipe", "ROS 1", "MCAP", SQLITE, *TABLES)
def named_pipe(folder: Path, log: WholeLog) -> Damaged:
    """To open it would wait for ever."""
    path = folder / f"a{log.suffix}"
    os.mkfifo(path)
    return refused(path)


@case("named pipe in a bag folder", "MCAP, zstd")
def named_pipe_in_a_bag(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / "run_2.mcap").unlink()
    os.mkfifo(bag / "run_2.mcap")
    return Damaged(bag, counts[0] + counts[1], (r"run_2\.mcap",))


@case("named pipe as metadata.yaml", "MCAP, zstd")
def named_pipe_as_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").unlink()
    os.mkfifo(bag / "metadata.yaml")
    return Damaged(bag, 0, ("metadata.yaml",), REFUSED)


@case("folder with a log's suffix", "MCAP", "CSV")
def folder_as_log(folder: Path, log: WholeLog) -> Damaged:
    path = folder / f"a{log.suffix}"
    path.mkdir()
    return refused(path, "holds no logs")


@case("10 GB of zeros behind the log", "ROS 1", *MCAP_CHUNKED[:1], SQLITE, where=Where.fused, only_read=True)
def zeros_behind(folder: Path, log: WholeLog) -> Damaged:
    """As a file system leaves what was allotted and not written when the power failed; the index is gone."""
    end = log.chunks[-1].end if log.chunks else len(log.content)
    path = log.write(folder / "a", log.content[:end])
    os.truncate(path, SPARSE_BYTES)
    return Damaged(path, log.n_messages)


@case("10 GB of zeros behind the log", "CSV", where=Where.fused, only_read=True)
def zeros_behind_rows(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    os.truncate(path, SPARSE_BYTES)
    return Damaged(path, log.n_messages)


@case("10 GB of zeros", "ROS 1", "MCAP", SQLITE, *TABLES, where=Where.fused, only_read=True)
def zeros(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a", b"")
    os.truncate(path, SPARSE_BYTES)
    return refused(path)


# --- Decompression bombs: 2 GB of zeros in some megabytes, in the place of a chunk that declares its true size


def zstd_bomb() -> bytes:
    """Run-length blocks of 128 KiB, the most that the format allows."""
    block = struct.pack("<I", (1 << 17 << 3) | (1 << 1))[:3] + b"\x00"
    head = b"\x28\xb5\x2f\xfd" + bytes([0x00, 0x38])  # no content size, window of 128 KiB
    last = struct.pack("<I", (1 << 3) | (1 << 1) | 1)[:3] + b"\x00"
    return head + block * (BOMB_BYTES >> 17) + last


def lz4_bomb() -> bytes:
    """Independent blocks of 4 MiB."""
    block = lz4.block.compress(bytes(1 << 22), store_size=False)
    head = b"\x04\x22\x4d\x18" + bytes([0x60, 0x70, 0x73])
    return head + (struct.pack("<I", len(block)) + block) * (BOMB_BYTES >> 22) + bytes(4)


def bz2_bomb() -> bytes:
    """One stream; a shorter bomb, for making it takes time."""
    compressor, piece = bz2.BZ2Compressor(9), bytes(1 << 22)
    return b"".join([*(compressor.compress(piece) for _ in range(16)), compressor.flush()])


@case("decompression bomb", "MCAP, lz4", "MCAP, zstd", "ROS 1, lz4", "ROS 1, bz2", where=Where.fused)
def bomb(folder: Path, log: WholeLog) -> Damaged:
    compression = log.kind.partition(", ")[2]
    chunk = log.chunks[2]
    content = {"zstd": zstd_bomb, "lz4": lz4_bomb, "bz2": bz2_bomb}[compression]()
    record = bytearray(log.content[chunk.start : chunk.data])
    if log.kind in MCAP:
        record[1:9] = struct.pack("<Q", len(record) - 9 + len(content))
        record[-8:] = struct.pack("<Q", len(content))
    else:
        record[-4:] = struct.pack("<I", len(content))
    path = log.write(
        folder / "a", log.content[: chunk.start] + bytes(record) + content + log.content[chunk.end :]
    )
    return all_but(log, path, chunk)


@case("decompression bomb that declares its size", "MCAP, lz4", "MCAP, zstd", "ROS 1, lz4", where=Where.fused)
def honest_bomb(folder: Path, log: WholeLog) -> Damaged:
    damaged = bomb(folder, log)
    chunk = log.chunks[2]
    content = bytearray(damaged.path.read_bytes())
    if log.kind in MCAP:
        content[chunk.start + 9 + 16 : chunk.start + 9 + 24] = struct.pack("<Q", BOMB_BYTES)
    else:
        size_at = content.index(b"size=", chunk.start) + len(b"size=")
        content[size_at : size_at + 4] = struct.pack("<I", BOMB_BYTES)
    damaged.path.write_bytes(content)
    return damaged


@case("columns of six million equal values", "Parquet", where=Where.fused, only_read=True)
def parquet_bomb(folder: Path, log: WholeLog) -> Damaged:
    """Run lengths: 54 million numbers in a file of some 100 kB. A log, to be read section by section."""
    names = polars.read_parquet(io.BytesIO(log.content)).columns
    million = folder / "million.parquet"
    polars.DataFrame({name: polars.zeros(1_000_000, eager=True) for name in names}).write_parquet(million)
    path = folder / "a.parquet"
    polars.concat([polars.scan_parquet(million)] * 6).sink_parquet(path)
    million.unlink()
    return Damaged(path, 12_000_000, n_whole=12_000_000)
