"""Reads ROS 1 bags, version 2.0, whole or damaged (wiki.ros.org/Bags/Format/2.0).

The file is read front to back, chunk by chunk, so the index at its end is not needed: bags that a crashed
recorder left (`.bag.active`) are read as far as they go.
"""

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.bounded_decompression import MAXIMUM_CHUNK_BYTES, DecompressionError, decompress
from pipeline.logs.message_blocks import BlockColumns, MessageBlock, ReadingLedger, Topic
from pipeline.logs.message_definitions import full_type_name
from pipeline.logs.raw_log import NANOSECONDS

MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
KNOWN_OPCODES = (MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION)
MAXIMUM_HEADER_BYTES = 1 << 20
WORD = struct.Struct("<I")
TIME = struct.Struct("<II")
POSITION = struct.Struct("<Q")
UNCHUNKED_BATCH_BYTES = 1 << 22


class _RecordError(Exception):
    """Bytes that are no record."""


def read_rosbag1(path: Path, ledger: ReadingLedger, wanted: Collection[str]) -> Iterator[MessageBlock]:
    """Yield the wanted topics' messages of one file, chunk by chunk.

    Raises:
        InputError: The file cannot be opened or is not a ROS 1 bag of version 2.0.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(len(VERSION))
            if magic.startswith(MAGIC) and magic != VERSION:
                raise InputError(
                    f"{path}: a ROS bag of another version than 2.0; convert it with `rosbag fix`"
                )
            if magic != VERSION:
                raise InputError(
                    f"{path}: not a ROS 1 bag (its first bytes are not `#ROSBAG V2.0`); remove it"
                )
            yield from _Scan(file, path.stat().st_size, ledger, wanted).blocks()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); check its permissions"
        ) from error


class _Scan:
    """One pass over the file."""

    def __init__(self, file: BinaryIO, size: int, ledger: ReadingLedger, wanted: Collection[str]) -> None:
        self.file = file
        self.size = size
        self.ledger = ledger
        self.wanted = wanted
        self.topics: dict[int, Topic] = {}
        self.chunk_starts: list[int] = []
        self.index_start = 0
        self.unchunked = bytearray()  # records of a chunk that the recorder did not live to close

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield blocks until the file or its readable part ends."""
        offset = len(VERSION)
        while offset < self.size:
            try:
                header, data_start, data_length = self.record(offset)
            except _RecordError as reason:
                following = self.next_indexed_chunk(offset)
                self.ledger.damage(offset, f"{reason}; {following - offset} bytes are lost")
                offset = following
                continue
            if header["op"][0] == BAG_HEADER and len(header.get("index_pos", b"")) == POSITION.size:
                (self.index_start,) = POSITION.unpack(header["index_pos"])
            end = data_start + data_length
            opcode = header["op"][0]
            if opcode == CHUNK:
                crashed = data_length == 0 and header.get("compression", b"none") != b"none"
                length = self.size - data_start if crashed else data_length
                yield from self.chunk(offset, header, data_start, length, crashed)
                end = self.size if crashed else end
            elif opcode in (CONNECTION, MESSAGE):
                self.file.seek(offset)
                self.unchunked += self.file.read(min(end, self.size) - offset)
                if len(self.unchunked) >= UNCHUNKED_BATCH_BYTES:
                    yield from self.flush(offset)
            elif end > self.size:
                self.ledger.damage(offset, "the file ends within this record")
            offset = end
        yield from self.flush(offset)

    def next_indexed_chunk(self, offset: int) -> int:
        """Return where the next chunk starts by the file's own index, or the file's size if it has none."""
        self.read_index()
        return min((start for start in self.chunk_starts if start > offset), default=self.size)

    def read_index(self) -> None:
        """Take in the index at the file's end, once: where chunks start, and the connections' repeated descriptions.

        It is only needed where the bag is damaged.
        """
        position, self.index_start = self.index_start, 0
        while 0 < position < self.size:
            try:
                header, data_start, data_length = self.record(position)
                if header["op"][0] == CONNECTION:
                    self.file.seek(data_start)
                    self.connect(header, self.file.read(min(data_length, MAXIMUM_HEADER_BYTES)))
            except _RecordError:
                break
            if header["op"][0] == CHUNK_INFO and len(header.get("chunk_pos", b"")) == POSITION.size:
                self.chunk_starts.append(POSITION.unpack(header["chunk_pos"])[0])
            position = data_start + data_length

    def record(self, offset: int) -> tuple[dict[str, bytes], int, int]:
        """Read a record's header: its fields, where its data start and how long they are."""
        self.file.seek(offset)
        word = self.file.read(WORD.size)
        if len(word) < WORD.size:
            raise _RecordError("the file ends within a record")
        (length,) = WORD.unpack(word)
        if length > MAXIMUM_HEADER_BYTES:
            raise _RecordError("no record of a ROS bag stands here")
        body = self.file.read(length + WORD.size)
        if len(body) < length + WORD.size:
            raise _RecordError("the file ends within a record's header")
        header = _fields(body[:length])
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
        yield from self.records(data, offset)

    def flush(self, offset: int) -> Iterator[MessageBlock]:
        """Yield the messages that stood outside of chunks."""
        if self.unchunked:
            data, self.unchunked = bytes(self.unchunked), bytearray()
            yield from self.records(data, offset)

    def records(self, data: bytes, offset: int) -> Iterator[MessageBlock]:
        """Walk message and connection records and yield one block per wanted connection."""
        columns = BlockColumns(np.frombuffer(data, np.uint8))
        position, end = 0, len(data)
        header_of = _MessageHeaderReader()
        word = WORD.unpack_from
        try:
            while position < end:
                if position + WORD.size > end:
                    raise _RecordError("a record ends early")
                (header_length,) = word(data, position)
                header_end = position + WORD.size + header_length
                start = header_end + WORD.size
                if start > end:
                    raise _RecordError("a record's header ends early")
                (length,) = word(data, header_end)
                following = start + length
                if following > end:
                    raise _RecordError("a record ends early")
                found = header_of(data, position + WORD.size, header_length)
                if found is not None:
                    columns.add(found[0], found[1], start, length)
                else:
                    header = _fields(data[position + WORD.size : header_end])
                    if header["op"][0] == CONNECTION:
                        self.connect(header, data[start:following])
                position = following
        except _RecordError as reason:
            lost = f"in the chunk that starts here, {reason}; {end - position} of its {end} bytes are lost"
            self.ledger.damage(offset, lost)
        if not columns.channels <= self.topics.keys():
            self.read_index()
        yield from columns.blocks(self.topics, self.ledger, self.wanted, offset)

    def connect(self, header: dict[str, bytes], data: bytes) -> None:
        """Take in a connection record."""
        description = {**header, **_fields(data, needs_opcode=False)}
        if len(header.get("conn", b"")) != WORD.size or "type" not in description:
            raise _RecordError("a connection's description is damaged")
        topic = Topic(
            name=header.get("topic", description.get("topic", b"")).decode(errors="replace"),
            type_name=full_type_name(description["type"].decode(errors="replace")),
            encoding="ros1",
            definition=description.get("message_definition", b"").decode(errors="replace"),
            definition_format="ros1msg",
        )
        self.topics[WORD.unpack(header["conn"])[0]] = topic
        self.ledger.add_topic(topic)


class _MessageHeaderReader:
    """Reads connection and time from message headers; the field order is that of the first header met."""

    def __init__(self) -> None:
        self.length = -1
        self.marks: list[tuple[int, int, bytes]] = []
        self.connection_offset = self.time_offset = 0

    def __call__(self, data: bytes, start: int, length: int) -> tuple[int, int] | None:
        """Return connection and log time, or None if the record is not a message."""
        if length == self.length:
            for begin, end, mark in self.marks:
                if data[start + begin : start + end] != mark:
                    break
            else:
                seconds, nanoseconds = TIME.unpack_from(data, start + self.time_offset)
                (connection,) = WORD.unpack_from(data, start + self.connection_offset)
                return connection, seconds * NANOSECONDS + nanoseconds
        raw = data[start : start + length]
        header = _fields(raw)
        if header["op"][0] != MESSAGE:
            return None
        if len(header.get("conn", b"")) != WORD.size or len(header.get("time", b"")) != TIME.size:
            raise _RecordError("a message's header is damaged")
        self._learn(raw, header)
        seconds, nanoseconds = TIME.unpack(header["time"])
        return WORD.unpack(header["conn"])[0], seconds * NANOSECONDS + nanoseconds

    def _learn(self, raw: bytes, header: dict[str, bytes]) -> None:
        """Remember where the values stand in headers of this length; all other bytes must be alike."""
        self.length, self.marks, begin, position = len(raw), [], 0, 0
        for name, value in header.items():
            value_start = position + WORD.size + len(name) + 1
            if name in ("conn", "time"):
                self.marks.append((begin, value_start, raw[begin:value_start]))
                begin = value_start + len(value)
                if name == "conn":
                    self.connection_offset = value_start
                else:
                    self.time_offset = value_start
            position = value_start + len(value)
        self.marks.append((begin, len(raw), raw[begin:]))


def _fields(body: bytes, needs_opcode: bool = True) -> dict[str, bytes]:
    """Read `name=value` fields in their order."""
    fields: dict[str, bytes] = {}
    position = 0
    while position < len(body):
        if position + WORD.size > len(body):
            raise _RecordError("no record of a ROS bag stands here")
        (length,) = WORD.unpack_from(body, position)
        position += WORD.size
        name, separator, value = body[position : position + length].partition(b"=")
        if not separator or position + length > len(body):
            raise _RecordError("no record of a ROS bag stands here")
        fields[name.decode(errors="replace")] = value
        position += length
    if needs_opcode and (len(fields.get("op", b"")) != 1 or fields["op"][0] not in KNOWN_OPCODES):
        raise _RecordError("no record of a ROS bag stands here")
    return fields
