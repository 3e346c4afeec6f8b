"""What an MCAP file states of itself at its end: its chunks, its channels and its number of messages."""

import struct
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BufferedReader

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(2, 9)
STATISTICS, DATA_END = 11, 15
PREFIX = struct.Struct("<BQ")  # opcode, length
FOOTER_FIELDS = struct.Struct("<QQI")  # start of the summary, start of its offsets, checksum
CHUNK_INDEX_START = struct.Struct("<QQQQ")  # first and last time, offset and length of the chunk's record
MESSAGE_COUNT = struct.Struct("<Q")  # the first field of the statistics
MAXIMUM_DESCRIPTION_BYTES = 1 << 24  # of a record that is read whole, as a schema; ROS's largest has 20 kB


@dataclass
class Summary:
    """The summary of a file, as far as it can be read.

    Attributes:
        file: Opened for reading, at any position.
        size: Its length in bytes.
        chunk_lengths: By offset of each chunk's record, the record's length in bytes.
        n_messages: How many messages the file states; None without statistics.
        descriptions: Opcode, offset and body of its schemas and channels.
    """

    file: BufferedReader
    size: int
    chunk_lengths: dict[int, int] = field(default_factory=dict)
    n_messages: int | None = None
    descriptions: list[tuple[int, int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for opcode, offset, body in self._records():
            if opcode == CHUNK_INDEX and len(body) >= CHUNK_INDEX_START.size:
                _, _, start, length = CHUNK_INDEX_START.unpack_from(body)
                if start + length <= self.size:
                    self.chunk_lengths[start] = length
            elif opcode == STATISTICS and len(body) >= MESSAGE_COUNT.size:
                (self.n_messages,) = MESSAGE_COUNT.unpack_from(body)
            elif opcode in (SCHEMA, CHANNEL):
                self.descriptions.append((opcode, offset, body))
        self.chunk_starts = sorted(self.chunk_lengths)

    def next_chunk(self, offset: int, before: int | None = None) -> int | None:
        """Return where the next chunk behind an offset begins, and not beyond another one; None without any.

        A chunk counts only if a record of the stated length stands there.
        """
        before = self.size if before is None else before
        for number in range(bisect_right(self.chunk_starts, offset), len(self.chunk_starts)):
            start = self.chunk_starts[number]
            if start >= before:
                break
            if self.has_chunk(start):
                return start
        return None

    def has_chunk(self, offset: int) -> bool:
        """Return whether a chunk is stated here and a record of its length stands here, whatever its opcode."""
        stated = self.chunk_lengths.get(offset)
        if stated is None:
            return False
        self.file.seek(offset)
        prefix = self.file.read(PREFIX.size)
        return len(prefix) == PREFIX.size and PREFIX.unpack(prefix)[1] == stated - PREFIX.size

    def _records(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield opcode, offset and body of the summary's records."""
        tail = PREFIX.size + FOOTER_FIELDS.size + len(MAGIC)
        end = max(self.size - tail, 0)
        self.file.seek(end)
        footer = self.file.read(tail)
        if len(footer) < tail or footer[0] != FOOTER or not footer.endswith(MAGIC):
            return
        position = FOOTER_FIELDS.unpack_from(footer, PREFIX.size)[0] or end
        while position + PREFIX.size <= end:
            self.file.seek(position)
            opcode, length = PREFIX.unpack(self.file.read(PREFIX.size))
            if length <= min(MAXIMUM_DESCRIPTION_BYTES, end - position - PREFIX.size):
                yield opcode, position, self.file.read(length)
            position += PREFIX.size + length
