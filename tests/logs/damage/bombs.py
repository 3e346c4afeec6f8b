"""Decompression bombs: 2 GB of zeros in some megabytes, in the place of a chunk that declares its true size."""

import bz2
import io
import struct
from pathlib import Path

import lz4.block
import polars

from tests.logs.damage.case import Damaged, Where, all_but, case
from tests.logs.samples.whole_logs import (
    MCAP,
    WholeLog,
)

BOMB_BYTES = 1 << 31


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
