"""JSON and Protobuf in MCAP files, and CAN logs: cut off, flipped, zeroed, empty, no log at all, hostile."""

import struct
import zlib
from pathlib import Path

from tests.logs.damage.case import Damaged, Where, case, flipped, refused
from tests.logs.whole_logs import BLF_HEADER_BYTES, CAN, CAN_BLF, CAN_TEXT, SELF_DESCRIBING, WholeLog

KINDS = (*SELF_DESCRIBING, *CAN)
SECTOR = 512
BOMB_BYTES = 1 << 27


@case("cut off after two thirds", *KINDS)
def two_thirds(folder: Path, log: WholeLog) -> Damaged:
    cut = (log.ends[2 * log.n_messages // 3] + log.ends[2 * log.n_messages // 3 + 1]) // 2 - 5
    path = log.write(folder / "a", log.content[:cut])
    return Damaged(path, log.n_before(cut), (path.name.replace(".", r"\."),))


@case("bit flip in a message", *SELF_DESCRIBING)
def flip_in_a_message(folder: Path, log: WholeLog) -> Damaged:
    """The length of a list or the name of a field: no checksum tells, the message does not fit any more."""
    number = log.n_messages // 2
    at = log.content.index(
        b"position" if b"{" in log.content[log.ends[0] - 90 : log.ends[0]] else b"swing", log.ends[number]
    )
    path = log.write(folder / "a", flipped(log.content, at, bit=2))
    return Damaged(path, log.n_messages - 1, (r"1 messages of /joint_states .* left out",))


@case("bit flip in a frame", *CAN_TEXT)
def flip_in_a_frame(folder: Path, log: WholeLog) -> Damaged:
    """A digit becomes a letter that is none of its data: the line is no frame."""
    at = log.ends[log.n_messages // 2] - 6
    return Damaged(log.write(folder / "a", flipped(log.content, at, bit=6)), log.n_messages - 1, may_differ=1)


@case("bit flip in a container", CAN_BLF)
def flip_in_a_container(folder: Path, log: WholeLog) -> Damaged:
    """The compression's checksum comes last: what stands before it is read, and may be wrong."""
    ends = sorted(set(log.ends))
    at = (ends[3] + ends[4]) // 2
    n_inside = log.ends.count(ends[4]) + 1
    path = log.write(folder / "a", flipped(log.content, at))
    return Damaged(path, log.n_messages - n_inside - 1, (r"a\.blf, byte \d+",), may_differ=n_inside)


@case("a sector of zeros", *KINDS)
def sector_of_zeros(folder: Path, log: WholeLog) -> Damaged:
    at = log.ends[log.n_messages // 2] + 20
    content = log.content[:at] + bytes(SECTOR) + log.content[at + SECTOR :]
    path = log.write(folder / "a", content)
    n_lost = log.n_before(at + 2 * SECTOR) - log.n_before(at - SECTOR)
    if (
        log.kind in SELF_DESCRIBING
    ):  # the rest of the chunk goes with it, for nothing tells where its records begin
        n_lost = max(chunk.n_messages for chunk in log.chunks)
    elif log.kind == CAN_BLF:
        n_lost = 3 * max(log.ends.count(end) for end in set(log.ends))
    return Damaged(path, log.n_messages - n_lost, (path.name.replace(".", r"\."),), may_differ=n_lost)


@case("empty file", *KINDS)
def empty_file(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b""))


@case("a file that is no log", *KINDS)
def no_log(folder: Path, log: WholeLog) -> Damaged:
    return refused(log.write(folder / "a", b"this is no log, whatever its name says\n" * 9))


@case("random bytes", *KINDS)
def random_bytes(folder: Path, log: WholeLog) -> Damaged:
    """Behind the format's own first bytes."""
    head = {CAN_BLF: BLF_HEADER_BYTES}.get(log.kind, log.ends[0] if log.kind in CAN else 8)
    noise = bytes((i * i * 7919 + i // 3) % 251 for i in range(20_000))
    return refused(log.write(folder / "a", log.content[:head] + noise))


@case("a line of 128 MiB", *CAN_TEXT, where=Where.fused, only_read=True)
def endless_line(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    with path.open("r+b") as file:
        file.truncate(1 << 27)
    return Damaged(path, log.n_messages, (r"line \d+ is no text",))


@case("decompression bomb", CAN_BLF, where=Where.fused)
def blf_bomb(folder: Path, log: WholeLog) -> Damaged:
    """128 MiB of zeros in the place of a container."""
    ends = sorted(set(log.ends))
    compressor, piece = zlib.compressobj(9), bytes(1 << 24)
    bomb = b"".join([*(compressor.compress(piece) for _ in range(BOMB_BYTES >> 24)), compressor.flush()])
    size = 32 + len(bomb)
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, size, 10, 2, BOMB_BYTES) + bomb + bytes(size % 4)
    path = log.write(folder / "a", log.content[: ends[2]] + container + log.content[ends[3] :])
    n_lost = log.ends.count(ends[3]) + 2
    return Damaged(path, log.n_messages - n_lost, (r"a\.blf, byte \d+: the container becomes longer",))


@case("a container that declares four gigabytes", CAN_BLF)
def immense_container(folder: Path, log: WholeLog) -> Damaged:
    ends = sorted(set(log.ends))
    content = bytearray(log.content)
    content[ends[2] + 8 : ends[2] + 12] = b"\xff" * 4
    path = log.write(folder / "a", bytes(content))
    return Damaged(path, log.n_messages - log.ends.count(ends[3]) - 2, (r"no BLF container stands here",))


@case("an object that declares four gigabytes", CAN_BLF)
def immense_object(folder: Path, log: WholeLog) -> Damaged:
    """Within a plain container, behind the header."""
    inside = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 0xFFFFFFF0, 86) + bytes(32)
    size = 32 + len(inside)
    container = (
        struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, size, 10, 0, len(inside)) + inside + bytes(size % 4)
    )
    content = log.content[:BLF_HEADER_BYTES] + container + log.content[BLF_HEADER_BYTES:]
    return Damaged(log.write(folder / "a", content), log.n_messages, (r"are no objects",))
