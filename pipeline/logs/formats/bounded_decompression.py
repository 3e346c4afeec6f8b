"""Decompression of chunks: at most the declared number of bytes, and the readable front of a truncated chunk."""

import bz2
from collections.abc import Callable

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
    """Decompress one chunk.

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
    if compression in ("", "none"):
        result, fault = data[: limit + 1], None
    elif compression in _STREAMS:
        result, fault = _STREAMS[compression](data, limit + 1, cut)
    else:
        raise DecompressionError(f"compression `{compression}` is unknown")
    if fault is not None and not cut:
        raise DecompressionError(fault, result)
    if len(result) > limit or (size is not None and len(result) != size and not cut):
        raise DecompressionError(f"the chunk has {len(result)} bytes and declares {size}", result[:limit])
    return result


def _zstd(data: bytes, limit: int, cut: bool) -> tuple[bytes, str | None]:
    try:
        if not cut:
            stated = zstandard.frame_content_size(data)
            if stated >= limit:
                return b"", f"zstd: the frame declares {stated} bytes"
            if stated >= 0:
                return zstandard.ZstdDecompressor().decompress(data), None
    except zstandard.ZstdError as error:
        return b"", f"zstd: {error}"
    decompressor, position = zstandard.ZstdDecompressor().decompressobj(), 0

    def read(_: int) -> bytes:
        nonlocal position
        result = b""
        while not result and not decompressor.eof and position < len(data):
            result = decompressor.decompress(data[position : position + ZSTD_PIECE_BYTES])
            position += ZSTD_PIECE_BYTES
        return result

    result, fault = _in_pieces(read, limit, zstandard.ZstdError)
    return result, fault or (
        None if decompressor.eof or len(result) >= limit else "zstd: the frame has no end"
    )


def _lz4(data: bytes, limit: int, cut: bool) -> tuple[bytes, str | None]:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    if not cut:
        try:
            result = decompressor.decompress(data, max_length=min(limit, len(data) * LZ4_MOST_PER_BYTE))
            if decompressor.eof:
                return result, None
        except RuntimeError:
            pass  # in pieces, so that bytes before the fault are kept
        decompressor.reset()
    waiting = data

    def read(n_bytes: int) -> bytes:
        nonlocal waiting
        if decompressor.eof:
            return b""
        piece, waiting = decompressor.decompress(waiting, max_length=n_bytes), b""
        return piece

    result, fault = _in_pieces(read, limit, RuntimeError)
    return result, fault or (
        None if decompressor.eof or len(result) >= limit else "lz4: the frame has no end"
    )


def _bz2(data: bytes, limit: int, cut: bool) -> tuple[bytes, str | None]:
    decompressor = bz2.BZ2Decompressor()
    waiting = data

    def read(n_bytes: int) -> bytes:
        nonlocal waiting
        if decompressor.eof:
            return b""
        piece, waiting = decompressor.decompress(waiting, n_bytes), b""
        return piece

    result, fault = _in_pieces(read, limit, OSError)
    return result, fault or (
        None if decompressor.eof or len(result) >= limit else "bz2: the stream has no end"
    )


def _in_pieces(
    read: Callable[[int], bytes], limit: int, fault_type: type[Exception]
) -> tuple[bytes, str | None]:
    """Read up to `limit` bytes; a fault ends the reading and keeps the earlier bytes."""
    pieces: list[bytes] = []
    total = 0
    while total < limit:
        try:
            piece = read(min(PIECE_BYTES, limit - total))
        except fault_type as error:
            return b"".join(pieces), str(error)
        if not piece:
            break
        pieces.append(piece)
        total += len(piece)
    return b"".join(pieces), None


PIECE_BYTES = 1 << 16
ZSTD_PIECE_BYTES = 1 << 10  # of compressed bytes; one can become 32 KiB, so that a piece is at most 32 MiB
LZ4_MOST_PER_BYTE = 255  # most bytes from one compressed byte; bounds the allocation
_STREAMS = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}
