"""Messages compressed one by one (`ros2 bag record --compression-mode message --compression-format zstd`).

They are recognised by their own bytes, so a bag without metadata is read, too: a CDR message begins with a zero byte, a
zstd frame never does.
"""

from collections.abc import Iterator

import numpy as np
import zstandard

from pipeline.logs.formats.compression.bounded_decompression import MAXIMUM_CHUNK_BYTES, DecompressionError
from pipeline.logs.formats.compression.compressed_file import MAXIMUM_EXPANSION
from pipeline.logs.messages.message_blocks import MessageBlock, ReadingLedger

FRAME_MAGIC = np.frombuffer(b"\x28\xb5\x2f\xfd", np.uint8)
BATCH_BYTES = 1 << 23  # of decompressed messages in one block
ALWAYS_ALLOWED_BYTES = 1 << 16  # of one message; zeros alone shrink more than `MAXIMUM_EXPANSION`


def decompressed_messages(block: MessageBlock, ledger: ReadingLedger) -> Iterator[MessageBlock]:
    """Yield a block as it is, or its messages decompressed, in blocks of bounded size.

    A message that cannot be decompressed is dropped and counted as damage, as is a message without zstd's mark among
    others with it.
    """
    if block.topic.encoding != "cdr" or not _are_frames(block).any():
        yield block
        return
    decompressor = zstandard.ZstdDecompressor()
    data = block.data.data
    times: list[int] = []
    messages: list[bytes] = []
    n_bytes, n_damaged, fault = 0, 0, ""
    ends = block.start + block.length
    for time_ns, start, end in zip(
        block.log_time_ns.tolist(), block.start.tolist(), ends.tolist(), strict=True
    ):
        try:
            message = _decompressed(data[start:end], decompressor)
        except DecompressionError as error:
            n_damaged, fault = n_damaged + 1, fault or str(error)
            continue
        times.append(time_ns)
        messages.append(message)
        n_bytes += len(message)
        if n_bytes >= BATCH_BYTES:
            yield _joined(block, times, messages)
            times, messages, n_bytes = [], [], 0
    if n_damaged:
        lost = f"{n_damaged} messages of {block.topic.name} cannot be decompressed ({fault}); they are lost"
        ledger.damage(None, lost, n_damaged)
    yield _joined(block, times, messages)


def _are_frames(block: MessageBlock) -> np.ndarray:
    """Return which messages begin with the mark of a zstd frame, shape (n,)."""
    start = block.start[block.length >= len(FRAME_MAGIC)]
    start = start[block.data[start] == FRAME_MAGIC[0]]
    return (block.data[start[:, None] + np.arange(len(FRAME_MAGIC))] == FRAME_MAGIC).all(axis=1)


def _decompressed(frame: memoryview, decompressor: zstandard.ZstdDecompressor) -> bytes:
    """Decompress one message.

    Raises:
        DecompressionError: The message is damaged or too large.
    """
    limit = min(max(ALWAYS_ALLOWED_BYTES, MAXIMUM_EXPANSION * len(frame)), MAXIMUM_CHUNK_BYTES)
    try:
        if zstandard.frame_content_size(frame) > limit:
            raise DecompressionError(f"it becomes more than {MAXIMUM_EXPANSION} times as long")
        return decompressor.decompress(frame, max_output_size=limit)
    except zstandard.ZstdError as error:
        raise DecompressionError(f"zstd: {error}") from error


def _joined(block: MessageBlock, times: list[int], messages: list[bytes]) -> MessageBlock:
    length = np.array([len(message) for message in messages], np.int64)
    data = np.frombuffer(b"".join(messages), np.uint8)
    return MessageBlock(block.topic, np.array(times, np.int64), data, np.cumsum(length) - length, length)
