"""Decompression of chunks: at most the declared number of bytes, and the readable front of a truncated chunk."""

import bz2
from collections.abc import Callable
from typing import Protocol, cast

import lz4.frame
import zstandard

MAXIMUM_CHUNK_BYTES = 1 << 29  # 512 MiB; recorders write 1 to 16 MiB, one raw image can make a chunk larger


class DecompressionError(Exception):
    """Compressed bytes that cannot be read completely.

    Attributes:
        front: Bytes decompressed before the fault.
    """

    def __init__(self, message: str, front: bytes = b"") -> None:
        super().__init__(message)
        self.front = front


def decompress(compression: str, data: bytes, size: int | None, cut: bool = False) -> bytes:
    """Decompress one chunk, which may be several frames.

    Args:
        compression: `""` or `none`, `lz4`, `zstd`, `bz2`.
        data: Compressed bytes.
        size: Declared length of the result; None where the format does not state it.
        cut: The bytes are known to be truncated: return the readable part without an error.

    Returns:
        The chunk, or the front of a truncated one.

    Raises:
        DecompressionError: The bytes are damaged, or longer than declared.
    """
    limit = MAXIMUM_CHUNK_BYTES if size is None else size
    if limit > MAXIMUM_CHUNK_BYTES:
        raise DecompressionError(f"the chunk declares {limit} bytes, more than {MAXIMUM_CHUNK_BYTES}")
    fault = None
    if compression in ("", "none"):
        result = data[: limit + 1]
    elif compression not in FRAMES:
        raise DecompressionError(f"compression `{compression}` is unknown")
    elif not cut and (whole := _at_once(compression, data, size)) is not None:
        result = whole
    else:
        pieces, fault = _in_pieces(compression, data, limit + 1)
        result = cast(bytes, pieces)  # it is read like bytes; a copy would double the memory
    if fault is not None and not cut:
        raise DecompressionError(fault, result)
    if len(result) > limit or (size is not None and len(result) != size and not cut):
        raise DecompressionError(f"the chunk has {len(result)} bytes and declares {size}", result[:limit])
    return result


class _Decompressor(Protocol):
    """One frame's decompressor, as in `bz2` and `lz4`."""

    @property
    def eof(self) -> bool: ...

    @property
    def needs_input(self) -> bool: ...

    @property
    def unused_data(self) -> bytes | None: ...

    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


class _ZstdFrame:
    """The same for zstd, whose decompressor does not bound its output: the input is given in small pieces."""

    def __init__(self) -> None:
        self.frame = zstandard.ZstdDecompressor().decompressobj()
        self.waiting = memoryview(b"")

    def decompress(self, data: bytes, max_length: int) -> bytes:
        """Return the next piece; at most 32 MiB, whatever `max_length`."""
        self.waiting = memoryview(data) if data else self.waiting
        piece, self.waiting = self.waiting[:ZSTD_PIECE_BYTES], self.waiting[ZSTD_PIECE_BYTES:]
        return self.frame.decompress(piece)

    @property
    def eof(self) -> bool:
        return self.frame.eof

    @property
    def needs_input(self) -> bool:
        return not self.waiting

    @property
    def unused_data(self) -> bytes:
        return self.frame.unused_data + self.waiting


def _at_once(compression: str, data: bytes, size: int | None) -> bytes | None:
    """Decompress a single sound frame, which is the rule; None if it is something else."""
    try:
        if compression == "zstd" and size is not None and zstandard.frame_content_size(data) == size:
            return zstandard.ZstdDecompressor().decompress(data)
        if compression == "lz4":
            limit = MAXIMUM_CHUNK_BYTES if size is None else size + 1
            frame = lz4.frame.LZ4FrameDecompressor()
            result = frame.decompress(data, max_length=min(limit, len(data) * LZ4_MOST_PER_BYTE))
            return result if frame.eof and not frame.unused_data else None
    except (zstandard.ZstdError, RuntimeError):
        pass  # in pieces, so that bytes before the fault are kept
    return None


def _in_pieces(compression: str, data: bytes, limit: int) -> tuple[bytearray, str | None]:
    """Decompress frame after frame up to `limit` bytes; a fault ends this and keeps the earlier bytes."""
    make, fault_type = FRAMES[compression]
    result, waiting = bytearray(), data
    while waiting and len(result) < limit and (not result or any(waiting[:4])):  # zeros are padding
        frame, n_before = make(), len(result)
        try:
            while not frame.eof and len(result) < limit and (waiting or not frame.needs_input):
                result += frame.decompress(waiting, min(PIECE_BYTES, limit - len(result)))
                waiting = b""
        except fault_type as error:
            # Bytes behind a whole frame that begin no other are padding.
            is_padding = waiting is not data and len(result) == n_before > 0
            return result, None if is_padding else f"{compression}: {error}"
        if not frame.eof and len(result) < limit:
            return result, f"{compression}: the frame has no end"
        waiting = frame.unused_data or b""
    return result, None if data else f"{compression}: the frame has no end"


PIECE_BYTES = 1 << 16
ZSTD_PIECE_BYTES = 1 << 10  # of compressed bytes; one can become 32 KiB, so that a piece is at most 32 MiB
LZ4_MOST_PER_BYTE = 255  # most bytes from one compressed byte; bounds the allocation
FRAMES: dict[str, tuple[Callable[[], _Decompressor], type[Exception]]] = {
    "zstd": (_ZstdFrame, zstandard.ZstdError),
    "lz4": (lz4.frame.LZ4FrameDecompressor, RuntimeError),
    "bz2": (bz2.BZ2Decompressor, OSError),
}
