"""The message index that follows a chunk of an MCAP file (mcap.dev/spec, op 0x07)."""

import numpy as np

from pipeline.logs.formats.indexed_chunk import IndexedRecords, records_at

MESSAGE_OPCODE = 5
RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
FIELDS_BYTES = 22  # from channel to publish time, counted in the record's length
ENTRY_WORDS = 2  # log time, offset in the decompressed chunk


def find_messages(data: np.ndarray, indexes: dict[int, np.ndarray]) -> IndexedRecords | None:
    """Find the message records of the index that are verified in the chunk.

    Args:
        data: The decompressed chunk, shape (n_bytes,), uint8.
        indexes: By channel, log time and offset of each message, shape (n, 2), uint64.

    Returns:
        The records; None if no entry is verified.
    """
    if not indexes or len(data) < RECORD.itemsize:
        return None
    words = np.concatenate(list(indexes.values())).T
    log_time, offset = np.ascontiguousarray(words)
    channel = np.repeat(list(indexes), [len(entries) for entries in indexes.values()])
    order = np.argsort(offset, kind="stable")
    n_within = int(np.searchsorted(offset, len(data) - RECORD.itemsize, side="right", sorter=order))
    order = order[:n_within]
    log_time, channel, begin = log_time[order], channel[order], offset[order].astype(np.int64)
    heads = records_at(data, begin, RECORD)
    length = heads["length"]
    true = (heads["opcode"] == MESSAGE_OPCODE) & (heads["channel"] == channel)
    true &= (heads["log_time"] == log_time) & (length >= FIELDS_BYTES) & (length <= len(data))
    start = begin + RECORD.itemsize
    message_length = length.astype(np.int64) - FIELDS_BYTES
    true &= start + message_length <= len(data)
    are_all = n_within == len(offset)
    found = IndexedRecords(channel, log_time, begin, start, message_length, are_all)
    return found.select(true)
