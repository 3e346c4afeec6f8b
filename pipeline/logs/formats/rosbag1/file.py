"""Read ROS 1 bags, version 2.0, intact or damaged (wiki.ros.org/Bags/Format/2.0).

The file is read front to back, chunk by chunk, so the index at its end is not needed: bags of a crashed
recorder (`.bag.active`) are read up to their last byte.
"""

import struct
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.bounded_decompression import MAXIMUM_CHUNK_BYTES, DecompressionError, decompress
from pipeline.logs.formats.indexed_chunk import describe_loss, gather_records
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
from pipeline.logs.messages.message_blocks import BlockColumns, LoggedTopic, MessageBlock, ReadingLedger
from pipeline.logs.messages.message_definitions import full_type_name

MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
RECORDS_START = (
    len(VERSION) + 4096
)  # the bag's header is padded to this length, so that it can be written last
MAXIMUM_HEADER_BYTES = 1 << 20
POSITION = struct.Struct("<Q")
UNCHUNKED_BATCH_BYTES = 1 << 22


def read_rosbag1(path: Path, ledger: ReadingLedger, wanted: Collection[str]) -> Iterator[MessageBlock]:
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

    def __init__(self, opened: OpenedFile, wanted: Collection[str]) -> None:
        self.file = opened.file
        self.size = opened.size
        self.ledger = opened.ledger
        self.wanted = wanted
        self.topics: dict[int, LoggedTopic] = {}
        self.chunk_starts: list[int] = []
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
            except RecordError as reason:
                following = self.next_place(offset)
                self.ledger.damage(offset, f"{reason}; {following - offset} bytes are lost")
                offset = following
                continue
            if header["op"][0] == BAG_HEADER and len(header.get("index_pos", b"")) == POSITION.size:
                (self.index_start,) = POSITION.unpack(header["index_pos"])
                self.is_closed = self.index_start != 0
            end = data_start + data_length
            opcode = header["op"][0]
            if opcode == CHUNK:
                crashed = data_length == 0 and header.get("compression", b"none") != b"none"
                length = self.size - data_start if crashed else data_length
                yield from self.chunk(offset, header, data_start, length, crashed)
                end = self.size if crashed else end
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
            offset = end
        yield from self.flush()
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
        self.read_index()
        return min((start for start in self.chunk_starts if offset < start < self.size), default=self.size)

    def read_index(self) -> None:
        """Read the index at the file's end, once: chunk offsets, and the connections' repeated descriptions.

        It is needed only if the bag is damaged.
        """
        position, self.index_start = self.index_start, 0
        while 0 < position < self.size:
            try:
                header, data_start, data_length = self.record(position)
                if header["op"][0] == CONNECTION:
                    self.file.seek(data_start)
                    self.connect(header, self.file.read(min(data_length, MAXIMUM_HEADER_BYTES)))
            except RecordError:
                break
            if header["op"][0] == CHUNK_INFO and len(header.get("chunk_pos", b"")) == POSITION.size:
                self.chunk_starts.append(POSITION.unpack(header["chunk_pos"])[0])
            position = data_start + data_length

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
        size = (
            WORD.unpack(header["size"])[0]
            if len(header.get("size", b"")) == WORD.size and not crashed
            else None
        )
        cut = crashed or data_start + length > self.size
        if length > MAXIMUM_CHUNK_BYTES:
            self.ledger.damage(offset, f"the chunk declares {length} bytes; it is lost")
            return
        self.file.seek(data_start)
        try:
            data = decompress(compression, self.file.read(length), size, cut)
        except DecompressionError as error:
            self.ledger.damage(offset, f"the chunk cannot be decompressed ({error}); the chunk is lost")
            return
        if cut:
            whole = "" if size is None else f" of its {size}"
            self.ledger.damage(offset, f"the file ends within this chunk; {len(data)}{whole} bytes were read")
        yield from self.records(data, offset, [] if cut else self.indexes(data_start + length))

    def flush(self) -> Iterator[MessageBlock]:
        """Yield the messages outside of chunks."""
        if self.unchunked:
            data, self.unchunked = bytes(self.unchunked), bytearray()
            offset, self.unchunked_start = self.unchunked_start or 0, None
            yield from self.records(data, offset, [])

    def indexes(self, offset: int) -> list[tuple[int, np.ndarray]]:
        """Read the index records that follow a chunk."""
        found: list[tuple[int, np.ndarray]] = []
        while offset < self.size:
            try:
                header, data_start, length = self.record(offset)
            except RecordError:
                break
            if header["op"][0] != INDEX or length > self.size - data_start:
                break
            entries = index_entries(header, self.file.read(length))
            if entries is not None:
                found.append(entries)
            offset = data_start + length
        return found

    def records(
        self, data: bytes, offset: int, indexes: list[tuple[int, np.ndarray]]
    ) -> Iterator[MessageBlock]:
        """Find message and connection records and yield one block per wanted connection."""
        reasons: list[str] = []
        header_of = MessageHeaderReader()

        def walk(begin: int, end: int, columns: BlockColumns) -> int:
            return self.walk(data, begin, end, columns, header_of, reasons)

        columns = BlockColumns(np.frombuffer(data, np.uint8))
        indexed = find_messages(data, indexes)
        columns, lost = gather_records(columns, len(data), indexed, walk, self.ledger)
        if lost:
            place = f"in the chunk that starts here, {reasons[-len(lost)]}"
            self.ledger.damage(offset, f"{place}; {describe_loss(lost, len(data))}")
        if not columns.channels <= self.topics.keys():
            self.read_index()
        yield from columns.blocks(self.topics, self.ledger, self.wanted, offset)

    def walk(
        self,
        data: bytes,
        position: int,
        end: int,
        columns: BlockColumns,
        header_of: MessageHeaderReader,
        reasons: list[str],
    ) -> int:
        """Walk the records of a stretch of a chunk; return its end, or the start of a damaged record and the reason."""
        word = WORD.unpack_from
        try:
            while position < end:
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
