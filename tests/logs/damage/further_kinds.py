"""JSON and Protobuf in MCAP files, CAN logs, LeRobot datasets: cut off, flipped, zeroed, empty, no log, hostile."""

import struct
import zlib
from pathlib import Path

import polars

from tests.logs.damage.case import Damaged, Where, case, flipped, refused
from tests.logs.samples.whole_logs import (
    BLF_HEADER_BYTES,
    CAN,
    CAN_BLF,
    CAN_TEXT,
    LEROBOT,
    LEROBOT_FRAMES,
    SELF_DESCRIBING,
    WholeLog,
    write_dataset,
)

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
    return Damaged(path, log.n_messages - 1, (r"1 message of /joint_states .* left out",))


@case("bit flip in a frame", *CAN_TEXT)
def flip_in_a_frame(folder: Path, log: WholeLog) -> Damaged:
    """A digit becomes a letter that data cannot hold: the line is not a frame."""
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


@case("a file that is not a log", *KINDS)
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
    return Damaged(path, log.n_messages, (r"line \d+ is not text",))


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
    return Damaged(log.write(folder / "a", content), log.n_messages, (r"hold no objects",))


def dataset(folder: Path, frames: bytes | None = None) -> Path:
    """A dataset, with other bytes as its file of frames."""
    path = write_dataset(folder / "a")
    if frames is not None:
        (path / LEROBOT_FRAMES).write_bytes(frames)
    return path


@case("cut off before its footer", LEROBOT)
def cut_frames(folder: Path, log: WholeLog) -> Damaged:
    return refused(
        dataset(folder, log.content[: len(log.content) // 2]), r"file-000\.parquet: not a readable table"
    )


@case("empty file", LEROBOT)
def empty_frames(folder: Path, log: WholeLog) -> Damaged:
    return refused(dataset(folder, b""), r"file-000\.parquet: not a readable table")


@case("bytes of the frames overwritten", LEROBOT)
def overwritten_frames(folder: Path, log: WholeLog) -> Damaged:
    """An episode is one row group, which is read up to the damage."""
    at = len(log.content) // 4
    content = log.content[:at] + b"\xff" * 500 + log.content[at + 500 :]
    return Damaged(dataset(folder, content), 0, (r"file-000\.parquet",), 2)


@case("frames of an episode are missing", LEROBOT)
def missing_frames(folder: Path, log: WholeLog) -> Damaged:
    path = dataset(folder)
    polars.read_parquet(path / LEROBOT_FRAMES)[:400].write_parquet(path / LEROBOT_FRAMES)
    return Damaged(path, 800, (r"400 frames of episode 0; the dataset states 600",))


@case("info.json of another kind", LEROBOT)
def odd_information(folder: Path, log: WholeLog) -> Damaged:
    """A million brackets behind the word by which datasets are known."""
    path = dataset(folder)
    (path / "meta/info.json").write_bytes(b'{"codebase_version": ' + b"[" * 1_000_000)
    return refused(path, r"info\.json: not a LeRobot dataset's description")


@case("a dataset of version 2", LEROBOT)
def older_dataset(folder: Path, log: WholeLog) -> Damaged:
    path = dataset(folder)
    text = (path / "meta/info.json").read_text().replace("v3.0", "v2.1")
    (path / "meta/info.json").write_text(text)
    return refused(path, "version v2.1 is not read; convert it")
