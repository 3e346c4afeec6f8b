"""Read a table of messages from the pages of an SQLite file, as arrays (sqlite.org/fileformat2.html).

The leaf pages of table `messages` are decoded in batches, as long as they hold what `ros2 bag record` writes: each cell
within its page, records of the known form, ascending row numbers. At the first batch with anything else this module
stops, and SQLite reads the rest. It recovers nothing that SQLite cannot read row by row, but it is six times as fast:
0.10 s of user time for 500,000 messages in 112 MB, against 0.63 s with `fetchmany` of 1,024 rows into the same arrays
(medians of three runs).
"""

import sqlite3
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from io import BufferedReader

import numpy as np

HEADER = struct.Struct(
    ">16sHBBB"
)  # magic, page size, write version, read version, bytes reserved in each page
MAXIMUM_PAGE_BYTES = 1 << 16
INTERIOR, LEAF = 5, 13
INTERIOR_HEADER, LEAF_HEADER = 12, 8
MAXIMUM_DEPTH = 8  # a tree of interior pages with hundreds of children each
LEAST_CELL_BYTES = 16  # bytes of a row: lengths, four serial types, a time
BATCH_BYTES = 1 << 22
PADDING = 64  # so that reading a few bytes behind a cell stays within the buffer
MARGIN = 8  # bytes before it
COLUMNS = [("id", "INTEGER", 1), ("topic_id", "INTEGER", 0), ("timestamp", "INTEGER", 0), ("data", "BLOB", 0)]
# Serial types of integers: 0 NULL, 1 to 6 integers of so many bytes, 8 and 9 the numbers 0 and 1.
INTEGER_BYTES = np.array([0, 1, 2, 3, 4, 6, 8, 0, 0, 0], np.int64)
IS_INTEGER = np.array([0, 1, 1, 1, 1, 1, 1, 0, 1, 1], bool)
FIRST_BLOB_TYPE = 12  # of an empty blob; each byte adds two


class UnusualError(Exception):
    """The pages are damaged or hold something unexpected."""


@dataclass(frozen=True)
class PageRows:
    """Rows of some pages, in order.

    Attributes:
        data: The pages, shape (n_bytes,), uint8.
        number: Row numbers, shape (n,), int64.
        topic: Topic numbers, shape (n,), int64.
        time_ns: Times, shape (n,), int64.
        start: Where each message begins in the pages, shape (n,), int64; invalid for topics that are not wanted.
        length: Length of each message, shape (n,), int64.
    """

    data: np.ndarray
    number: np.ndarray
    topic: np.ndarray
    time_ns: np.ndarray
    start: np.ndarray
    length: np.ndarray


def rows_in_pages(
    file: BufferedReader, size: int, connection: sqlite3.Connection, wanted: Collection[int]
) -> Iterator[PageRows]:
    """Yield the rows of table `messages` as long as the pages are as expected.

    Args:
        file: The database, without a journal.
        size: Its length in bytes.
        connection: The database opened by SQLite, for the schema.
        wanted: Numbers of the topics whose messages are needed.

    Raises:
        UnusualError: SQLite must read the remaining rows.
    """
    pages = _Pages(file, size)
    last = 0
    wanted_topics = np.array(sorted(wanted), np.int64)
    for numbers in pages.batches(_root(connection)):
        rows = _decoded(pages.read(numbers), len(numbers), pages, wanted_topics)
        if len(rows.number):
            if rows.number[0] <= last:
                raise UnusualError("rows repeat")
            last = int(rows.number[-1])
            yield rows


def truncated_rows(file: BufferedReader, size: int) -> set[int]:
    """Return the rows that the file's end truncates.

    SQLite pads the last page with zeros, and would return such rows as if they were complete.
    """
    try:
        pages = _Pages(file, size)
    except UnusualError:
        return set()
    available = size % pages.size
    if available < LEAF_HEADER:
        return set()
    file.seek(size - available)
    page = np.zeros(pages.size + PADDING, np.uint8)
    page[:available] = np.frombuffer(file.read(available), np.uint8)
    n_cells = int(page[3]) << 8 | int(page[4])
    end = LEAF_HEADER + 2 * n_cells
    if page[0] != LEAF or end > available:
        return set()
    cell = page[LEAF_HEADER:end].view(">u2").astype(np.int64)
    cell = cell[(cell >= end) & (cell < available)]
    try:
        payload_length, n_bytes = _varint(page, cell, 9)
        number, n_more = _varint(page, cell + n_bytes, 9)
    except UnusualError:
        return set()
    cell_end = cell + n_bytes + n_more + _local_bytes(payload_length, pages.usable)
    is_cut = (cell_end > available) | (cell + LEAST_CELL_BYTES > available)
    return set(number[is_cut].tolist())


def _root(connection: sqlite3.Connection) -> int:
    """Return the number of the table's root page."""
    try:
        columns = [
            (name, kind, key)
            for _, name, kind, _, _, key in connection.execute("PRAGMA table_info(messages)")
        ]
        roots = connection.execute(
            "SELECT rootpage, sql FROM sqlite_master WHERE type = 'table' AND name = 'messages'"
        ).fetchall()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise UnusualError("a damaged schema") from error
    if columns != COLUMNS or len(roots) != 1 or not isinstance(roots[0][0], int):
        raise UnusualError("another table")
    if "WITHOUT" in str(roots[0][1]).upper():
        raise UnusualError("another table")
    return roots[0][0]


class _Pages:
    """The pages of a file."""

    def __init__(self, file: BufferedReader, size: int) -> None:
        self.file = file
        file.seek(0)
        head = file.read(HEADER.size)
        if len(head) < HEADER.size:
            raise UnusualError("no header")
        _, page_size, _, _, reserved = HEADER.unpack(head)
        self.size = MAXIMUM_PAGE_BYTES if page_size == 1 else page_size
        if self.size < 512 or self.size & (self.size - 1):
            raise UnusualError("no page size")
        self.usable = self.size - reserved
        self.count = size // self.size

    def read(self, numbers: list[int]) -> np.ndarray:
        """Read pages into one buffer, followed by padding; shape (n_pages * size + PADDING,), uint8."""
        if min(numbers) < 2 or max(numbers) > self.count:
            raise UnusualError("no such page")
        buffer = np.zeros(len(numbers) * self.size + PADDING, np.uint8)
        view = buffer.data
        begin = 0
        while begin < len(numbers):  # runs of neighbours at once
            end = begin + 1
            while end < len(numbers) and numbers[end] == numbers[end - 1] + 1:
                end += 1
            self.file.seek((numbers[begin] - 1) * self.size)
            target = view[begin * self.size : end * self.size]
            if self.file.readinto(target) != len(target):
                raise UnusualError("the file ends")
            begin = end
        return buffer

    def batches(self, root: int) -> Iterator[list[int]]:
        """Yield the numbers of the leaf pages below a page, in order, in batches."""
        depth = self._depth(root)
        limit = max(BATCH_BYTES // self.size, 1)
        batch: list[int] = []
        total = 0
        for children in self._leaves(root, depth):
            total += len(children)
            if total > self.count:
                raise UnusualError("pages refer to each other in a circle")
            batch += children
            while len(batch) >= limit:
                yield batch[:limit]
                batch = batch[limit:]
        if batch:
            yield batch

    def _depth(self, number: int) -> int:
        """Return the number of levels of interior pages."""
        for depth in range(MAXIMUM_DEPTH):
            page = self.read([number])
            if page[0] == LEAF:
                return depth
            number = self._children(page)[0]
        raise UnusualError("pages refer to each other in a circle")

    def _leaves(self, number: int, depth: int) -> Iterator[list[int]]:
        if depth == 0:
            yield [number]
            return
        children = self._children(self.read([number]))
        if depth == 1:
            yield children
            return
        for child in children:
            yield from self._leaves(child, depth - 1)

    def _children(self, page: np.ndarray) -> list[int]:
        """Return the children of an interior page."""
        n_cells = int(page[3]) << 8 | int(page[4])
        end = INTERIOR_HEADER + 2 * n_cells
        if page[0] != INTERIOR or n_cells == 0 or end > self.usable:
            raise UnusualError("no interior page")
        pointers = page[INTERIOR_HEADER:end].view(">u2").astype(np.int64)
        if pointers.min() < end or pointers.max() > self.usable - 5:
            raise UnusualError("no interior page")
        _, n_key_bytes = _varint(page, pointers + 4, 9)
        _require((pointers + 4 + n_key_bytes <= self.usable).all())
        left = (page[pointers[:, None] + np.arange(4)].astype(np.int64) << [24, 16, 8, 0]).sum(axis=1)
        return [*left.tolist(), int.from_bytes(page[8:12].tobytes())]


def _decoded(data: np.ndarray, n_pages: int, pages: _Pages, wanted: np.ndarray) -> PageRows:
    """Decode the cells of leaf pages.

    Raises:
        UnusualError: A cell is not a row of the known form.
    """
    size, usable = pages.size, pages.usable
    heads = data[: n_pages * size].reshape(n_pages, size)[:, :LEAF_HEADER].astype(np.int64)
    n_cells = heads[:, 3] << 8 | heads[:, 4]
    pointers_end = LEAF_HEADER + 2 * n_cells
    _require((heads[:, 0] == LEAF).all() and (n_cells > 0).all() and (pointers_end <= usable).all())
    page = np.repeat(np.arange(n_pages) * size, n_cells)
    first = np.repeat(np.cumsum(n_cells) - n_cells, n_cells)
    place = page + LEAF_HEADER + 2 * (np.arange(len(page)) - first)
    pointer = data[place].astype(np.int64) << 8 | data[place + 1]
    _require((pointer >= np.repeat(pointers_end, n_cells)).all() and (pointer < usable).all())
    cell = page + pointer
    payload_length, n_bytes = _varint(data, cell, 4)
    number, n_more = _varint(data, cell + n_bytes, 5)
    payload = cell + n_bytes + n_more
    topic_type, time_type = data[payload + 2], data[payload + 3]
    _require((data[payload + 1] == 0).all() and (np.maximum(topic_type, time_type) < len(IS_INTEGER)).all())
    _require((IS_INTEGER[topic_type] & IS_INTEGER[time_type]).all())
    data_type, n_type_bytes = _varint(data, payload + 4, 5)
    length = (data_type - FIRST_BLOB_TYPE) >> 1
    _require((data_type >= FIRST_BLOB_TYPE).all() and not (data_type & 1).any())
    header_length = 4 + n_type_bytes
    _require((data[payload] == header_length).all())
    topic_at = payload + header_length
    time_at = topic_at + INTEGER_BYTES[topic_type]
    start = time_at + INTEGER_BYTES[time_type]
    _require((payload_length == start - payload + length).all())
    topic = _integer(data, topic_at, topic_type)
    time_ns = _integer(data, time_at, time_type)
    _require((number[1:] > number[:-1]).all())
    _require((payload + _local_bytes(payload_length, usable) <= page + usable).all())
    is_local = payload_length <= usable - 35
    _require((is_local | ~np.isin(topic, wanted)).all())
    return PageRows(data, number, topic, time_ns, start, length)


def _local_bytes(payload_length: np.ndarray, usable: int) -> np.ndarray:
    """Return how many bytes of each payload lie in the leaf page, including the number of the overflow page."""
    least = (usable - 12) * 32 // 255 - 23
    spilled = least + (payload_length - least) % (usable - 4)
    spilled = np.where(spilled <= usable - 35, spilled, least) + 4
    return np.where(payload_length <= usable - 35, payload_length, spilled)


def _varint(data: np.ndarray, at: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Decode variable-length integers of up to `most` bytes: values and their lengths in bytes."""
    byte = data[at]
    value = (byte & 0x7F).astype(np.int64)
    n_bytes = np.ones(len(at), np.int64)
    goes_on = byte >= 0x80
    for _ in range(most - 1):
        if not goes_on.any():
            return value, n_bytes
        byte = data[at + n_bytes]
        value = np.where(goes_on, value << 7 | (byte & 0x7F), value)
        n_bytes += goes_on
        goes_on &= byte >= 0x80
    _require(not goes_on.any())
    return value, n_bytes


def _integer(data: np.ndarray, at: np.ndarray, serial_type: np.ndarray) -> np.ndarray:
    """Decode big-endian integers in two's complement."""
    n_bytes = INTEGER_BYTES[serial_type]
    # The eight bytes that end with the integer; the leading ones are shifted out.
    eight = np.ndarray((len(data) - 7,), ">u8", buffer=data, strides=(1,))[at + n_bytes - 8].astype(np.uint64)
    shift = (64 - 8 * n_bytes).astype(np.uint64)
    value = np.where(
        n_bytes > 0, (eight << (shift & np.uint64(63))).view(np.int64) >> shift.view(np.int64), 0
    )
    return np.where(n_bytes > 0, value, serial_type.astype(np.int64) - 8)


def _require(condition: bool | np.bool_) -> None:
    if not condition:
        raise UnusualError("a page is unusual")
