"""One log in every format, by other people's tools, and where in its file every message ends.

The places are found by walkers of a few lines and by the compression libraries, so that what a damaged copy must still
yield is known without the readers that are tested.
"""

import bz2
import functools
import re
import sqlite3
import struct
import tempfile
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import lz4.frame
import numpy as np
import polars
import zstandard
from rosbags.rosbag2 import StoragePlugin

from pipeline.configuration.load import load_machine
from pipeline.logs.export.lerobot import write_lerobot
from pipeline.logs.tuples import Trajectory
from tests.logs.conftest import Session, make_session
from tests.logs.samples import can_logs, self_describing_bags
from tests.logs.samples import foreign_bags as foreign

ROS1 = ("ROS 1", "ROS 1, bz2", "ROS 1, lz4")
MCAP_CHUNKED = ("MCAP", "MCAP, lz4", "MCAP, zstd")
MCAP_UNCHUNKED = "MCAP without chunks"
MCAP_UNCHECKED = "MCAP without checksums"
MCAP = (*MCAP_CHUNKED, MCAP_UNCHUNKED, MCAP_UNCHECKED)
SQLITE = "SQLite"
BAGS = (*ROS1, *MCAP, SQLITE)
TABLES = ("CSV", "Parquet")
SELF_DESCRIBING = (
    "MCAP with JSON",
    "MCAP with Protobuf",
)  # without checksums, so that damage reaches the messages
CAN_TEXT = ("CAN, candump", "CAN, ASC")
CAN_BLF = "CAN, BLF"
CAN = (*CAN_TEXT, CAN_BLF)
LEROBOT = "LeRobot"  # a folder: `content` is its file of frames
LEROBOT_FRAMES = Path("data/chunk-000/file-000.parquet")
SUFFIXES = {
    **dict.fromkeys(ROS1, ".bag"),
    **dict.fromkeys(MCAP, ".mcap"),
    SQLITE: ".db3",
    "CSV": ".csv",
    "Parquet": ".parquet",
    **dict.fromkeys(SELF_DESCRIBING, ".mcap"),
    "CAN, candump": ".log",
    "CAN, ASC": ".asc",
    CAN_BLF: ".blf",
    LEROBOT: "",
}
SECONDS = 12
ROW_GROUP = 100
ROSBAG1_VERSION = b"#ROSBAG V2.0\n"
MCAP_MAGIC_BYTES = 8
BLF_HEADER_BYTES = 144
DECOMPRESSORS = {
    "bz2": bz2.decompress,
    "lz4": lz4.frame.decompress,
    "zstd": lambda data: zstandard.ZstdDecompressor().decompressobj().decompress(data),
}


@dataclass(frozen=True)
class Record:
    """A record of a ROS 1 bag or an MCAP file: its kind, and where it and its body stand in the file."""

    opcode: int
    start: int
    body: int
    end: int


@dataclass(frozen=True)
class Chunk:
    """A chunk: its record, where its compressed bytes begin, how many messages it holds."""

    start: int
    data: int
    end: int
    n_messages: int


@dataclass(frozen=True)
class WholeLog:
    """An undamaged log.

    Attributes:
        kind: Format and compression, as the list of damage names them.
        suffix: Of its file.
        content: Its bytes.
        session: What was recorded.
        n_messages: Joint samples and commands; a row of a table counts as one of each.
        ends: Where messages end in the file, ascending: each of an uncompressed log, those of whole chunks of another.
        chunks: In the order of the file.
        records: In the order of the file, for ROS 1 and MCAP.
    """

    kind: str
    suffix: str
    content: bytes
    session: Session
    n_messages: int
    ends: list[int]
    chunks: list[Chunk] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)

    def n_before(self, offset: int) -> int:
        """Messages that end before a byte of the file."""
        return bisect_right(self.ends, offset)

    def first(self, opcode: int, after: int = 0) -> Record:
        """The first record of a kind."""
        return next(record for record in self.records if record.opcode == opcode and record.start >= after)

    def write(self, path: Path, content: bytes | None = None) -> Path:
        """Write a copy, or other bytes under its suffix."""
        path = path.with_name(path.name + self.suffix)
        path.write_bytes(self.content if content is None else content)
        return path


def rosbag1_records(data: bytes) -> Iterator[Record]:
    """Walk the records of a ROS 1 bag (wiki.ros.org/Bags/Format/2.0); all writers put `op` somewhere in the header."""
    position = len(ROSBAG1_VERSION)
    while position < len(data):
        (header_length,) = struct.unpack_from("<I", data, position)
        header = data[position + 4 : position + 4 + header_length]
        body = position + 4 + header_length + 4
        (length,) = struct.unpack_from("<I", data, body - 4)
        yield Record(header[header.index(b"op=") + 3], position, body, body + length)
        position = body + length


def mcap_records(data: bytes, position: int = MCAP_MAGIC_BYTES) -> Iterator[Record]:
    """Walk the records of an MCAP file or chunk (mcap.dev/spec)."""
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        yield Record(opcode, position, position + 9, position + 9 + length)
        position += 9 + length


def entries_of(store: object, session: Session | None = None) -> list[tuple[int, str, object]]:
    """The session's messages, as `foreign_bags` writes them."""
    return foreign.messages(store, session or recorded(), load_machine("bobcat_e10").joint_names)


@functools.cache
def recorded() -> Session:
    """What all whole logs hold."""
    return make_session(load_machine("bobcat_e10"), seconds=SECONDS)


@functools.cache
def whole_log(kind: str) -> WholeLog:
    """Return the log in one format."""
    with tempfile.TemporaryDirectory() as folder:
        path = _write(Path(folder), kind)
        content = path.read_bytes()
    session = recorded()
    n_messages = len(session.q) + len(session.command)
    if kind in ROS1:
        records = list(rosbag1_records(content))
        chunks, ends = _rosbag1_chunks(content, records, kind)
    elif kind in (*MCAP, *SELF_DESCRIBING):
        records = list(mcap_records(content))
        chunks, ends = _mcap_chunks(content, records, kind)
        if kind == MCAP_UNCHUNKED:
            ends = [record.end for record in records if record.opcode == 5]
    elif kind == LEROBOT:
        n_messages, records, chunks, ends = 2 * len(session.q), [], [], []
    elif kind in CAN:
        records, chunks = [], []
        ends = _blf_ends(content) if kind == CAN_BLF else _frame_ends(content)
    elif kind == SQLITE:
        records, chunks, ends = [], [], _sqlite_ends(content)
    else:
        n_messages = 2 * len(session.q)
        records, chunks, ends = [], [], []
        if kind == "CSV":
            lines = np.cumsum([len(line) for line in content.splitlines(keepends=True)])[1:]
            ends = np.repeat(lines, 2).tolist()
    assert not ends or len(ends) == n_messages, kind
    return WholeLog(kind, SUFFIXES[kind], content, session, n_messages, ends, chunks, records)


def _write(folder: Path, kind: str) -> Path:
    _, _, compression = kind.partition(", ")
    if kind in ROS1:
        return foreign.write_rosbag1(folder / "a.bag", entries_of(foreign.ROS1), compression or "none")
    if kind == SQLITE:
        return next(foreign.write_rosbag2(folder / "a", entries_of(foreign.ROS2)).glob("*.db3"))
    if kind == MCAP_UNCHECKED:
        bag = foreign.write_rosbag2(folder / "a", entries_of(foreign.ROS2), StoragePlugin.MCAP)
        return next(bag.glob("*.mcap"))
    if kind in SELF_DESCRIBING:
        encoding, names = kind.rpartition(" ")[2].lower(), load_machine("bobcat_e10").joint_names
        return self_describing_bags.write(
            folder / "a.mcap", encoding, recorded(), names, "none", enable_crcs=False
        )
    if kind == LEROBOT:
        return write_dataset(folder / "a") / LEROBOT_FRAMES
    if kind in CAN:
        frames = can_logs.frames(recorded(), load_machine("bobcat_e10").joint_names)
        return can_logs.write(folder / f"a{SUFFIXES[kind]}", frames)
    if kind in MCAP:
        chunked = kind != MCAP_UNCHUNKED
        return foreign.write_mcap(folder / "a.mcap", entries_of(foreign.ROS2), compression or "none", chunked)
    return write_table(folder / f"a{SUFFIXES[kind]}")


def write_dataset(path: Path) -> Path:
    """Write the joint samples as one episode at 50 Hz, each with the command in force."""
    session, machine = recorded(), replace(load_machine("bobcat_e10"), rate_hz=50.0)
    in_force = np.maximum(np.searchsorted(session.command_ns, session.stamp_ns, side="right") - 1, 0)
    steps = np.arange(len(session.q))
    episode = Trajectory(
        "a",
        0.02 * steps,
        100_000_000_000 + 20_000_000 * steps,
        session.q,
        session.q,
        session.command[in_force],
        steps < 0,
    )
    write_lerobot(path, machine, [episode], "dig")
    return path


def write_table(path: Path, n_rows: int | None = None) -> Path:
    """Write the joint samples, each with the command in force, as the default column map expects them."""
    session, joints = recorded(), load_machine("bobcat_e10").joint_names
    in_force = np.maximum(np.searchsorted(session.command_ns, session.stamp_ns, side="right") - 1, 0)
    columns = {"t": 100.0 + 0.02 * np.arange(len(session.q))}
    columns |= {f"q_{joint}": session.q[:, i] for i, joint in enumerate(joints)}
    columns |= {f"a_{joint}": session.command[in_force, i] for i, joint in enumerate(joints)}
    frame = polars.DataFrame(columns)[:n_rows]
    if path.suffix == ".csv":
        frame.write_csv(path)
    else:
        frame.write_parquet(path, row_group_size=ROW_GROUP)
    return path


def _rosbag1_chunks(content: bytes, records: list[Record], kind: str) -> tuple[list[Chunk], list[int]]:
    chunks, ends = [], []
    for record in records:
        if record.opcode != 5:
            continue
        body = content[record.body : record.end]
        compression = kind.partition(", ")[2]
        data = DECOMPRESSORS[compression](body) if compression else body
        inner = [r for r in rosbag1_records(ROSBAG1_VERSION + data) if r.opcode == 2]
        chunks.append(Chunk(record.start, record.body, record.end, len(inner)))
        shift = record.body - len(ROSBAG1_VERSION)
        ends += [record.end if compression else shift + r.end for r in inner]
    return chunks, ends


def _mcap_chunks(content: bytes, records: list[Record], kind: str) -> tuple[list[Chunk], list[int]]:
    chunks, ends = [], []
    for record in records:
        if record.opcode != 6:
            continue
        (name_length,) = struct.unpack_from("<I", content, record.body + 28)
        data_at = record.body + 32 + name_length + 8
        compression = content[record.body + 32 : data_at - 8].decode()
        body = content[data_at : record.end]
        data = DECOMPRESSORS[compression](body) if compression else body
        inner = [r for r in mcap_records(data, 0) if r.opcode == 5]
        chunks.append(Chunk(record.start, data_at, record.end, len(inner)))
        ends += [record.end if compression else data_at + r.end for r in inner]
    return chunks, ends


def _frame_ends(content: bytes) -> list[int]:
    """Where the lines end that hold frames."""
    lines = content.splitlines(keepends=True)
    ends = np.cumsum([len(line) for line in lines]).tolist()
    return [end for line, end in zip(lines, ends, strict=True) if re.match(rb"\(\d|\s*\d+\.\d+ +1  ", line)]


def _blf_ends(content: bytes) -> list[int]:
    """Where the containers end in which each frame does."""
    position, stream, ends = BLF_HEADER_BYTES, b"", []
    while position < len(content):
        (size,) = struct.unpack_from("<L", content, position + 8)
        stream += zlib.decompress(content[position + 32 : position + size])
        position += size + size % 4
        while len(stream) >= 16 and len(stream) >= (length := struct.unpack_from("<L", stream, 8)[0]):
            stream = stream[length + length % 4 :]
            ends.append(position)
    return ends


def _sqlite_ends(content: bytes) -> list[int]:
    """Where the page ends that holds each row; rows that cannot be found count as the next one that can."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        path.write_bytes(content)
        connection = sqlite3.connect(path)
        (page_bytes,) = connection.execute("PRAGMA page_size").fetchone()
        rows = connection.execute("SELECT data FROM messages ORDER BY id").fetchall()
        connection.close()
    ends, page_end = [], len(content)
    for (data,) in reversed(rows):
        if content.count(data) == 1:  # commands that are held repeat
            page_end = (content.index(data) // page_bytes + 1) * page_bytes
        ends.append(page_end)
    assert ends == sorted(ends, reverse=True)
    return ends[::-1]
