"""Single bits that flipped, and stretches that were overwritten."""

import sqlite3
import struct
from pathlib import Path

from tests.logs.damage.case import SQLITE_PAGE, Damaged, all_but, at_byte, case, flipped, refused
from tests.logs.samples.whole_logs import (
    MCAP,
    MCAP_CHUNKED,
    MCAP_UNCHECKED,
    MCAP_UNCHUNKED,
    ROS1,
    ROW_GROUP,
    SQLITE,
    WholeLog,
)


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
