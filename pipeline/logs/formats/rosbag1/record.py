"""Records of ROS 1 bags: header fields and the headers of messages (wiki.ros.org/Bags/Format/2.0)."""

import struct
from dataclasses import dataclass

from pipeline.logs.messages.raw_log import NANOSECONDS

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
KNOWN_OPCODES = (MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION)
WORD = struct.Struct("<I")
TIME = struct.Struct("<II")


class RecordError(Exception):
    """The bytes are not a record."""


def fields_of(body: bytes, needs_opcode: bool = True) -> dict[str, bytes]:
    """Read `name=value` fields in their order.

    Raises:
        RecordError: The bytes are not fields, or lack the opcode.
    """
    fields: dict[str, bytes] = {}
    position = 0
    while position < len(body):
        if position + WORD.size > len(body):
            raise RecordError("no record of a ROS bag stands here")
        (length,) = WORD.unpack_from(body, position)
        position += WORD.size
        name, separator, value = body[position : position + length].partition(b"=")
        if not separator or position + length > len(body):
            raise RecordError("no record of a ROS bag stands here")
        fields[name.decode(errors="replace")] = value
        position += length
    if needs_opcode and (
        len(fields.get("op", b"")) != 1
        or (
            fields["op"][0] not in KNOWN_OPCODES and "compression" not in fields
        )  # only chunks have that field
    ):
        raise RecordError("no record of a ROS bag stands here")
    return fields


@dataclass(frozen=True)
class HeaderLayout:
    """Offsets of connection and time in a message's header; its other bytes are equal in every message.

    Attributes:
        template: An example header.
        connection_offset: Offset of the connection's number.
        time_offset: Offset of the time.
    """

    template: bytes
    connection_offset: int
    time_offset: int

    @property
    def marks(self) -> list[tuple[int, int, bytes]]:
        """The stretches (begin, end, bytes) between and beside connection and time."""
        values = sorted(
            [(self.connection_offset, WORD.size), (self.time_offset, TIME.size), (len(self.template), 0)]
        )
        marks, begin = [], 0
        for offset, size in values:
            marks.append((begin, offset, self.template[begin:offset]))
            begin = offset + size
        return marks


def layout_of(raw: bytes, header: dict[str, bytes]) -> HeaderLayout | None:
    """Find the layout of a message's header.

    Args:
        raw: The header.
        header: Its fields, with a connection and a time.

    Returns:
        The layout; None if a field occurs twice or its name is not ASCII.
    """
    position, offsets = 0, {}
    for name, value in header.items():
        offsets[name] = position + WORD.size + len(name) + 1
        if not name.isascii():
            return None
        position = offsets[name] + len(value)
    if position != len(raw):
        return None
    return HeaderLayout(raw, offsets["conn"], offsets["time"])


def message_fields(raw: bytes) -> dict[str, bytes] | None:
    """Read a message's header; None for another kind of record.

    Raises:
        RecordError: The bytes are not a header, or connection or time are damaged.
    """
    header = fields_of(raw)
    if header["op"][0] != MESSAGE:
        return None
    if len(header.get("conn", b"")) != WORD.size or len(header.get("time", b"")) != TIME.size:
        raise RecordError("a message's header is damaged")
    return header


class MessageHeaderReader:
    """Reads connection and time from message headers; fast if the layout equals the previous one."""

    def __init__(self) -> None:
        self.length = -1
        self.marks: list[tuple[int, int, bytes]] = []
        self.connection_offset = self.time_offset = 0

    def __call__(self, data: bytes, start: int, length: int) -> tuple[int, int] | None:
        """Return connection and log time in ns, or None if the record is not a message.

        Raises:
            RecordError: The bytes are not a record's header.
        """
        if length == self.length:
            for begin, end, mark in self.marks:
                if data[start + begin : start + end] != mark:
                    break
            else:
                seconds, nanoseconds = TIME.unpack_from(data, start + self.time_offset)
                (connection,) = WORD.unpack_from(data, start + self.connection_offset)
                return connection, seconds * NANOSECONDS + nanoseconds
        raw = data[start : start + length]
        header = message_fields(raw)
        if header is None:
            return None
        layout = layout_of(raw, header)
        if layout is not None:
            self.length, self.marks = length, layout.marks
            self.connection_offset, self.time_offset = layout.connection_offset, layout.time_offset
        seconds, nanoseconds = TIME.unpack(header["time"])
        return WORD.unpack(header["conn"])[0], seconds * NANOSECONDS + nanoseconds
