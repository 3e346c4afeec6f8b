"""Bags compressed as whole files (`ros2 bag record --compression-mode file --compression-format zstd`)."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import zstandard

from pipeline.errors import InputError
from pipeline.logs.messages.message_blocks import ReadingLedger

COMPRESSED_SUFFIXES = (".zstd", ".zst")  # of rosbag2 and of the command `zstd`
PIECE_BYTES = 1 << 10  # one compressed byte can become 32 KiB: a piece is at most 32 MiB in memory
# Recordings do not shrink a thousandfold: such a file is a decompression bomb or empty.
MAXIMUM_EXPANSION = 1000
ALWAYS_ALLOWED_BYTES = 1 << 28
KEPT_FREE_BYTES = 1 << 28  # of the temporary folder's disk, for other programs
BYTES_BETWEEN_CHECKS = 1 << 26


class _Damage(Exception):
    """Compressed bytes are damaged or truncated."""


def decompress_file(path: Path, source: BinaryIO, target: Path, ledger: ReadingLedger) -> None:
    """Decompress the readable part of a file, and note in the ledger whether bytes were lost.

    Args:
        path: The compressed file's path, for messages.
        source: The compressed file.
        target: Where the result is written.
        ledger: Where damage is noted.

    Raises:
        InputError: Nothing can be decompressed, or the result exceeds the disk or `MAXIMUM_EXPANSION`.
        OSError: The file cannot be read, or the result cannot be written.
    """
    limit = max(ALWAYS_ALLOWED_BYTES, MAXIMUM_EXPANSION * path.stat().st_size)
    written, next_check = 0, 0
    with target.open("wb") as file:
        try:
            for piece in _pieces(source):
                written += len(piece)
                if written > limit:
                    raise InputError(
                        f"{path}: becomes more than {MAXIMUM_EXPANSION} times as long when it is decompressed, so it "
                        "is hardly a bag; decompress it with `unzstd` if it is one"
                    )
                if written > next_check:
                    _check_room(path, target.parent)
                    next_check = written + BYTES_BETWEEN_CHECKS
                file.write(piece)
        except _Damage as reason:
            if not written:
                raise InputError(f"{path}: cannot be decompressed ({reason}); restore it") from reason
            lost = f"the compressed file cannot be read on ({reason}); the {written} bytes before were decompressed"
            ledger.damage(source.tell(), lost)


def _check_room(path: Path, folder: Path) -> None:
    free = shutil.disk_usage(folder).free
    if free < KEPT_FREE_BYTES + BYTES_BETWEEN_CHECKS:
        raise InputError(
            f"{path}: no room to decompress it in {folder.parent} ({free >> 20} MiB are free, "
            f"{KEPT_FREE_BYTES >> 20} are kept); free some, or let TMPDIR name a folder that has more"
        )


def _pieces(source: BinaryIO) -> Iterator[bytes]:
    """Decompress a file of zstd frames piece by piece."""
    decompressor = zstandard.ZstdDecompressor()
    frame, is_within = decompressor.decompressobj(), True
    while piece := source.read(PIECE_BYTES):
        while piece:
            try:
                result = frame.decompress(piece)
            except zstandard.ZstdError as error:
                raise _Damage(str(error).removeprefix("zstd decompressor error: ")) from error
            if result:
                yield result
            is_within = not frame.eof
            piece = frame.unused_data if frame.eof else b""
            if frame.eof:
                frame = decompressor.decompressobj()
    if is_within:
        raise _Damage("it ends early")
