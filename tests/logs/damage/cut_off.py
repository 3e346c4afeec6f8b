"""Logs of a recorder that crashed, or files that were cut off."""

from pathlib import Path

from tests.logs.damage.case import EVERY_KIND, Damaged, at_byte, case, refused
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import (
    MCAP,
    MCAP_CHUNKED,
    MCAP_UNCHECKED,
    MCAP_UNCHUNKED,
    ROS1,
    SQLITE,
    WholeLog,
    entries_of,
)


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
    says = (f"{at_byte(row)}: the file ends within this row",)
    return Damaged(log.write(folder / "a", log.content[:cut]), log.n_before(row), says)


@case("cut off before its footer", "Parquet")
def no_footer(folder: Path, log: WholeLog) -> Damaged:
    """Columns and their places stand in the footer only."""
    return refused(log.write(folder / "a", log.content[: 9 * len(log.content) // 10]))


@case("cut off after its first bytes", *EVERY_KIND)
def only_a_head(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", log.content[:50]))
