"""Finds the messages of an MCAP chunk by its message index, as arrays, and trusts nothing that the index says.

Every place that the index names is checked: a message record of that channel and that time must stand there, and the
records must lie side by side. What lies between them is left to be walked record by record. So the messages found are
those of a walk over the whole chunk.
"""

from dataclasses import dataclass

import numpy as np

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
PREFIX_BYTES = 9  # opcode and length, which the length does not count
ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])


@dataclass(frozen=True)
class IndexedMessages:
    """Messages of one channel: log time, start and length of their data, each of shape (n,)."""

    channel: int
    log_time_ns: np.ndarray
    start: np.ndarray
    length: np.ndarray


def find_messages(
    data: np.ndarray, indexes: dict[int, np.ndarray]
) -> tuple[list[IndexedMessages], list[tuple[int, int]]] | None:
    """Find messages by index.

    Args:
        data: The decompressed chunk, shape (n_bytes,), uint8.
        indexes: Entries by channel, of type `ENTRY`.

    Returns:
        The messages, and the stretches (begin, end) between them; None where index and chunk contradict each other.
    """
    entries = np.concatenate([*indexes.values(), np.zeros(0, ENTRY)])
    channels = np.repeat(list(indexes), [len(entry) for entry in indexes.values()])
    if (
        len(entries) == 0
        or len(data) < RECORD.itemsize
        or (entries["offset"] > len(data) - RECORD.itemsize).any()
    ):
        return None
    order = np.argsort(entries["offset"], kind="stable")
    entries, channels = entries[order], channels[order]
    begin = entries["offset"].astype(np.int64)
    heads = np.ndarray((len(data) - RECORD.itemsize + 1,), RECORD, buffer=data, strides=(1,))[begin]
    in_chunk = heads["length"] <= len(data)
    alike = (heads["opcode"] == MESSAGE_OPCODE) & (heads["channel"] == channels)
    if not (in_chunk & alike & (heads["log_time"] == entries["log_time"])).all():
        return None
    length = heads["length"].astype(np.int64) - (RECORD.itemsize - PREFIX_BYTES)
    start = begin + RECORD.itemsize
    end = start + length
    if (length < 0).any() or end[-1] > len(data) or (begin[1:] < end[:-1]).any():
        return None
    left, right = np.concatenate([[0], end]), np.concatenate([begin, [len(data)]])
    apart = left < right
    between = list(zip(left[apart].tolist(), right[apart].tolist(), strict=True))
    log_time = entries["log_time"]
    found = []
    for channel in indexes:
        own = channels == channel
        found.append(IndexedMessages(channel, log_time[own], start[own], length[own]))
    return found, between
