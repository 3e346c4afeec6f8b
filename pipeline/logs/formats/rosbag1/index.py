"""The index that follows a chunk of a ROS 1 bag (wiki.ros.org/Bags/Format/2.0, op 4)."""

import numpy as np

from pipeline.logs.formats.indexed_chunk import IndexedRecords, records_at
from pipeline.logs.formats.rosbag1.record import (
    TIME,
    WORD,
    HeaderLayout,
    RecordError,
    layout_of,
    message_fields,
)
from pipeline.logs.messages.raw_log import NANOSECONDS

INDEX_VERSION = WORD.pack(1)
ENTRY_WORDS = 3  # seconds, nanoseconds, offset in the decompressed chunk
TEMPLATES_TRIED = 8  # more than one, in case the first record is damaged
MAXIMUM_HEADER_BYTES = 1 << 10  # of a message record's header, which has some 40


def index_entries(header: dict[str, bytes], data: bytes) -> tuple[int, np.ndarray] | None:
    """Read an index record.

    Returns:
        Its connection, and seconds, nanoseconds and offset of each message, shape (n, 3), uint32. None if the record is
        damaged or of another version.
    """
    connection, count = header.get("conn", b""), header.get("count", b"")
    if header.get("ver") != INDEX_VERSION or len(connection) != WORD.size or len(count) != WORD.size:
        return None
    if len(data) != WORD.unpack(count)[0] * ENTRY_WORDS * WORD.size:
        return None
    return WORD.unpack(connection)[0], np.frombuffer(data, "<u4").reshape(-1, ENTRY_WORDS)


def find_messages(data: bytes, indexes: list[tuple[int, np.ndarray]]) -> IndexedRecords | None:
    """Find the message records of the index that are verified in the chunk.

    Every header must equal the first readable one except in connection and time, which must equal the index's.

    Args:
        data: The decompressed chunk.
        indexes: Result of `index_entries` for each index record.

    Returns:
        The records; None if no entry is verified.
    """
    if not indexes:
        return None
    columns = np.concatenate([entries for _, entries in indexes]).T
    connection = np.repeat([number for number, _ in indexes], [len(entries) for _, entries in indexes])
    seconds, nanoseconds, offset = np.ascontiguousarray(columns)
    order = np.argsort(offset, kind="stable")
    layout = _layout(data, offset[order[:TEMPLATES_TRIED]])
    if layout is None:
        return None
    record = _record_type(layout)
    n_within = int(np.searchsorted(offset, max(len(data) - record.itemsize, 0), side="right", sorter=order))
    order = order[:n_within]
    seconds, nanoseconds, connection = seconds[order], nanoseconds[order], connection[order]
    begin = offset[order].astype(np.int64)
    heads = records_at(np.frombuffer(data, np.uint8), begin, record)
    length = heads["length"].astype(np.int64)
    start = begin + record.itemsize
    log_time = seconds.astype(np.uint64) * np.uint64(NANOSECONDS) + nanoseconds
    expected = np.frombuffer(bytearray(_template(layout) * n_within), record)
    expected["connection"], expected["length"] = connection, heads["length"]
    expected["seconds"], expected["nanoseconds"] = seconds, nanoseconds
    true = start + length <= len(data)
    if heads.tobytes() != expected.tobytes():
        shape = (n_within, record.itemsize)
        true &= (heads.view(np.uint8).reshape(shape) == expected.view(np.uint8).reshape(shape)).all(axis=1)
    found = IndexedRecords(connection, log_time, begin, start, length, n_within == len(offset))
    return found.select(true)


def _layout(data: bytes, offsets: np.ndarray) -> HeaderLayout | None:
    """Return the layout of the first readable header at these offsets."""
    for begin in offsets.tolist():
        head = data[begin : begin + WORD.size + MAXIMUM_HEADER_BYTES]
        if len(head) < WORD.size:
            return None
        (length,) = WORD.unpack_from(head)
        raw = head[WORD.size : WORD.size + length]
        try:
            if len(raw) == length and (header := message_fields(raw)) and (layout := layout_of(raw, header)):
                return layout
        except RecordError:
            continue
    return None


def _record_type(layout: HeaderLayout) -> np.dtype:
    """Return the type of a message record before its message: header length, header, message length."""
    header_end = WORD.size + len(layout.template)
    time_at = WORD.size + layout.time_offset
    at = {
        "connection": WORD.size + layout.connection_offset,
        "seconds": time_at,
        "nanoseconds": time_at + TIME.size // 2,
        "length": header_end,
    }
    return np.dtype(
        {
            "names": list(at),
            "formats": ["<u4"] * len(at),
            "offsets": list(at.values()),
            "itemsize": header_end + WORD.size,
        }
    )


def _template(layout: HeaderLayout) -> bytes:
    return WORD.pack(len(layout.template)) + layout.template + bytes(WORD.size)
