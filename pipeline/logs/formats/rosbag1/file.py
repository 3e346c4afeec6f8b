"""Read ROS 1 bags, version 2.0, intact or damaged (wiki.ros.org/Bags/Format/2.0).

The file is read front to back, chunk by chunk, so the index at its end is not needed: bags of a crashed
recorder (`.bag.active`) are read up to their last byte. The number of messages is held against the index's.

User time for 756,000 messages in 100 MB: 0.07 to 0.09 s; with `rosbags`, read in blocks, 7.4 to 8.5 s
(`benchmarks.log_readers`). Of a bag cut in half `rosbags` gives nothing, and it ends at a damaged chunk.
"""

import struct
from bisect import bisect_right
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.compression.bounded_decompression import (
    MAXIMUM_CHUNK_BYTES,
    DecompressionError,
    decompress,
)
from pipeline.logs.formats.indexed_chunk import describe_loss, gather_records, record_budget
from pipeline.logs.formats.opened_file import OpenedFile, opened_file
from pipeline.logs.formats.rosbag1.index import find_messages, index_entries
from pipeline.logs.formats.rosbag1.record import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    MESSAGE,
    WORD,
    MessageHeaderReader,
    RecordError,
    fields_of,
)
from pipeline.logs.messages.decoding.definitions import full_type_name
from pipeline.logs.messages.message_blocks import BlockColumns, LoggedTopic, MessageBlock, ReadingLedger

MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
RECORDS_START = len(VERSION) + 4096  # the bag's header is padded, so that it can be written last
MAXIMUM_HEADER_BYTES = 1 << 20
POSITION = struct.Struct("<Q")
UNCHUNKED_BATCH_BYTES = 1 << 22
MAXIMUM_UNCHUNKED_BYTES = 1 << 27  # of a record outside of chunks


def read_rosbag1(path: Path, ledger: ReadingLedger, wanted: Container[str]) -> Iterator[MessageBlock]:
    """Yield the wanted topics' messages of one file, chunk by chunk.

    Raises:
        InputError: The file cannot be opened or is not a ROS 1 bag of version 2.0.
    """
    with opened_file(path, ledger) as opened:
        magic = opened.file.read(len(VERSION))
        if magic.startswith(MAGIC) and magic != VERSION:
            raise InputError(f"{path}: a ROS bag of another version than 2.0; convert it with `rosbag fix`")
        if magic != VERSION:
            raise InputError(f"{path}: not a ROS 1 bag (its first bytes are not `#ROSBAG V2.0`); remove it")
        yield from _RecordScan(opened, wanted).blocks()


class _RecordScan:
    """One pass over the file."""

    def __init__(self, opened: OpenedFile, wanted: Container[str]) -> None:
        self.file = opened.file
        self.size = opened.size
        self.ledger = opened.ledger
        self.wanted = wanted
        self.topics: dict[int, LoggedTopic] = {}
        self.chunk_counts: dict[
            int, int
        ] = {}  # messages by offset of the chunk, as the bag's index states them
        self.chunk_starts: list[int] = []
        self.n_found = self.n_indexed = self.n_found_indexed = 0  # messages in chunks
        self.indexes_end = 0  # of the records that index the last chunk
        self.index_start = 0
        self.is_closed = True  # unless the bag's header says otherwise
        self.unchunked = bytearray()  # records of a chunk that the recorder did not close
        self.unchunked_start: int | None = None  # offset of that chunk, or of the first record

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield blocks until the file or its readable part ends."""
        offset, n_notes = len(VERSION), len(self.ledger.notes)
        while offset < self.size:
            try:
                header, data_start, data_length = self.record(offset)
                end = data_start + data_length
                opcode = header["op"][0]
                if (swallowed := self.next_chunk(offset, min(end, self.size))) != self.size:
                    raise RecordError(f"a record declares {data_length} bytes and holds byte {swallowed}")
                if opcode in (CONNECTION, MESSAGE) and min(end, self.size) - offset > MAXIMUM_UNCHUNKED_BYTES:
                    raise RecordError(f"a record declares {data_length} bytes")
            except RecordError as reason:
                following = self.next_place(offset)
                self.ledger.damage(offset, f"{reason}; {following - offset} bytes are lost")
                offset = following
                continue
            if opcode == BAG_HEADER and len(header.get("index_pos", b"")) == POSITION.size:
                (self.index_start,) = POSITION.unpack(header["index_pos"])
                self.is_closed = self.index_start != 0
                self.read_index()
            if "compression" in header and opcode != CHUNK:
                self.ledger.damage(
                    offset, f"the record's opcode {opcode} is damaged; its fields are a chunk's"
                )
                opcode = CHUNK
            if opcode == CHUNK:
                crashed = data_length == 0 and header.get("compression", b"none") != b"none"
                length = self.size - data_start if crashed else data_length
                yield from self.chunk(offset, header, data_start, length, crashed)
                end = self.size if crashed else max(end, self.indexes_end)
                if data_length == 0:
                    self.unchunked_start = offset
            elif opcode in (CONNECTION, MESSAGE):
                self.file.seek(offset)
                self.unchunked_start = offset if self.unchunked_start is None else self.unchunked_start
                self.unchunked += self.file.read(min(end, self.size) - offset)
                if len(self.unchunked) >= UNCHUNKED_BATCH_BYTES:
                    yield from self.flush()
            elif end > self.size:
                self.ledger.damage(offset, "the file ends within this record")
            elif opcode == INDEX and len(count := header.get("count", b"")) == WORD.size:
                self.n_indexed += WORD.unpack(count)[0]  # of a chunk that was not read
            offset = end
        yield from self.flush()
        if self.chunk_counts:
            self.ledger.compare_counts("its index states", sum(self.chunk_counts.values()), self.n_found)
        elif self.n_found_indexed < self.n_indexed:
            self.ledger.compare_counts("its chunks' indexes list", self.n_indexed, self.n_found_indexed)
        if len(self.ledger.notes) > n_notes:
            return
        if not self.is_closed:
            self.ledger.damage(
                self.size, "the recorder did not close this bag; what it had not written is lost"
            )
        elif self.index_start > self.size:  # truncated exactly at a record's end
            self.ledger.damage(self.size, "the file ends before its index; what stood between is lost")

    def next_place(self, offset: int) -> int:
        """Return where to resume after damage: the next chunk's start from the file's index, or the file's end."""
        if offset == len(VERSION) < RECORDS_START < self.size:
            return RECORDS_START
        return self.next_chunk(offset, self.size)

    def next_chunk(self, offset: int, before: int) -> int:
        """Return where the next chunk between two offsets begins; the file's size without one.

        A chunk of the index counts only if a chunk's record stands there.
        """
        for number in range(bisect_right(self.chunk_starts, offset), len(self.chunk_starts)):
            start = self.chunk_starts[number]
            if start >= before:
                break
            with suppress(RecordError):
                if "compression" in self.record(start)[0]:
                    return start
        return self.size

    def read_index(self) -> None:
        """Read the index at the file's end: the chunks' offsets and message counts, the connections' descriptions."""
        position = self.index_start
        while 0 < position < self.size:
            try:
                header, data_start, data_length = self.record(position)
                data = self.file.read(min(data_length, MAXIMUM_HEADER_BYTES))
                if header["op"][0] == CONNECTION:
                    self.connect(header, data)
            except RecordError:
                break
            if header["op"][0] == CHUNK_INFO and len(header.get("chunk_pos", b"")) == POSITION.size:
                words = np.frombuffer(data, "<u4", len(data) // WORD.size)
                counts = words[1::2]  # behind each connection's number
                self.chunk_counts[POSITION.unpack(header["chunk_pos"])[0]] = int(counts.sum())
            position = data_start + data_length
        self.chunk_starts = sorted(self.chunk_counts)

    def record(self, offset: int) -> tuple[dict[str, bytes], int, int]:
        """Read a record's header: its fields, and start and length of its data."""
        self.file.seek(offset)
        word = self.file.read(WORD.size)
        if len(word) < WORD.size:
            raise RecordError("the file ends within a record")
        (length,) = WORD.unpack(word)
        if length > MAXIMUM_HEADER_BYTES:
            raise RecordError("no record of a ROS bag stands here")
        body = self.file.read(length + WORD.size)
        if len(body) < length + WORD.size:
            raise RecordError("the file ends within a record's header")
        header = fields_of(body[:length])
        return header, offset + WORD.size + length + WORD.size, WORD.unpack_from(body, length)[0]

    def chunk(
        self, offset: int, header: dict[str, bytes], data_start: int, length: int, crashed: bool
    ) -> Iterator[MessageBlock]:
        """Yield the blocks of one chunk."""
        compression = header.get("compression", b"none").decode(errors="replace")
        size = WORD.unpack(header["size"])[0] if len(header.get("size", b"")) == WORD.size else 0
        # An uncompressed chunk is as long as its record. Until 2023 the writer of `rosbags` wrote 1 for every size.
        known_size = size if size > 1 and compression != "none" and not crashed else None
        cut = crashed or data_start + length > self.size
        if length > MAXIMUM_CHUNK_BYTES:
            self.ledger.damage(offset, f"the chunk declares {length} bytes; it is lost")
            return
        self.file.seek(data_start)
        try:
            stored = self.file.read(length)
            data = decompress(compression, stored, known_size, cut)
        except DecompressionError as error:
            self.ledger.damage(offset, f"the chunk cannot be decompressed ({error}); the chunk is lost")
            return
        if cut:
            whole = f" of its {size}" if size > 1 and not crashed else ""
            self.ledger.damage(offset, f"the file ends within this chunk; {len(data)}{whole} bytes were read")
        yield from self.records(data, offset, [] if cut else self.indexes(data_start + length), len(stored))

    def flush(self) -> Iterator[MessageBlock]:
        """Yield the messages outside of chunks."""
        if self.unchunked:
            data, self.unchunked = bytes(self.unchunked), bytearray()
            offset, self.unchunked_start = self.unchunked_start or 0, None
            yield from self.records(data, offset, [], len(data))

    def indexes(self, offset: int) -> list[tuple[int, np.ndarray]]:
        """Read the index records that follow a chunk."""
        found: list[tuple[int, np.ndarray]] = []
        while offset < self.size:
            try:
                header, data_start, length = self.record(offset)
            except RecordError:
                break
            if header["op"][0] != INDEX or "compression" in header or length > self.size - data_start:
                break
            entries = index_entries(header, self.file.read(length))
            if entries is not None:
                found.append(entries)
            offset = data_start + length
        self.indexes_end = offset
        return found

    def records(
        self, data: bytes, offset: int, indexes: list[tuple[int, np.ndarray]], n_stored_bytes: int
    ) -> Iterator[MessageBlock]:
        """Find message and connection records and yield one block per wanted topic."""
        reasons: list[str] = []
        header_of = MessageHeaderReader()
        budget = record_budget(n_stored_bytes)

        def walk(begin: int, end: int, columns: BlockColumns) -> int:
            return self.walk(data, begin, end, columns, header_of, reasons, budget)

        columns = BlockColumns(np.frombuffer(data, np.uint8))
        lost = gather_records(columns, len(data), find_messages(data, indexes), walk, self.ledger)
        if lost:
            place = f"in the chunk that starts here, {reasons[-len(lost)]}"
            self.ledger.damage(offset, f"{place}; {describe_loss(lost, len(data))}")
        self.n_found += len(columns)
        if indexes:
            self.n_indexed += sum(len(entries) for _, entries in indexes)
            self.n_found_indexed += len(columns)
        yield from columns.blocks(self.topics, self.ledger, self.wanted, offset)

    def walk(
        self,
        data: bytes,
        position: int,
        end: int,
        columns: BlockColumns,
        header_of: MessageHeaderReader,
        reasons: list[str],
        budget: Iterator[int],
    ) -> int:
        """Walk the records of a stretch of a chunk; return its end, or the start of a damaged record and the reason."""
        word = WORD.unpack_from
        try:
            for _ in budget:
                if position >= end:
                    return position
                if position + WORD.size > end:
                    raise RecordError("a record ends early")
                (header_length,) = word(data, position)
                header_end = position + WORD.size + header_length
                start = header_end + WORD.size
                if start > end:
                    raise RecordError("a record's header ends early")
                (length,) = word(data, header_end)
                following = start + length
                if following > end:
                    raise RecordError("a record ends early")
                found = header_of(data, position + WORD.size, header_length)
                if found is not None:
                    columns.add(found[0], found[1], start, length)
                else:
                    header = fields_of(data[position + WORD.size : header_end])
                    if header["op"][0] == CONNECTION:
                        self.connect(header, data[start:following])
                position = following
            reasons.append("more records than its bytes can hold")
        except RecordError as reason:
            reasons.append(str(reason))
        return position

    def connect(self, header: dict[str, bytes], data: bytes) -> None:
        """Read a connection record."""
        description = {**header, **fields_of(data, needs_opcode=False)}
        if len(header.get("conn", b"")) != WORD.size or "type" not in description:
            raise RecordError("a connection's description is damaged")
        topic = LoggedTopic(
            name=header.get("topic", description.get("topic", b"")).decode(errors="replace"),
            type_name=full_type_name(description["type"].decode(errors="replace")),
            encoding="ros1",
            definition=description.get("message_definition", b"").decode(errors="replace"),
            definition_format="ros1msg",
        )
        self.topics[WORD.unpack(header["conn"])[0]] = topic
        self.ledger.add_topic(topic)
