"""Read MCAP files, intact or damaged (mcap.dev/spec).

The data section is read front to back, chunk by chunk, so a file without summary, index or end is read up to its last
byte. A chunk whose checksum fails is dropped completely, because the wrong bytes are unknown. The front of a truncated
chunk is used.
"""

import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.bounded_decompression import MAXIMUM_CHUNK_BYTES, DecompressionError, decompress
from pipeline.logs.formats.indexed_chunk import describe_loss, gather_records
from pipeline.logs.formats.mcap.index import ENTRY_WORDS, find_messages
from pipeline.logs.formats.message_compression import decompressed_messages
from pipeline.logs.formats.opened_file import OpenedFile, opened_file
from pipeline.logs.messages.message_blocks import BlockColumns, LoggedTopic, MessageBlock, ReadingLedger
from pipeline.logs.messages.message_definitions import full_type_name
from pipeline.logs.messages.protobuf_messages import BYTES_AS_TEXT

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, DATA_END = 2, 3, 4, 5, 6, 7, 8, 15
BINARY_SCHEMAS = ("protobuf", "flatbuffer")
KNOWN_OPCODES = range(1, 16)
PREFIX = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEADER = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
MESSAGE_FIELDS = MESSAGE_HEADER.size - PREFIX.size
CHUNK_HEADER = struct.Struct(
    "<QQQII"
)  # start, end, uncompressed size, checksum, length of the compression's name
INDEX_HEADER = struct.Struct("<HI")  # channel, length of its entries in bytes
ENTRY_BYTES = 8 * ENTRY_WORDS
CHUNK_INDEX_START = struct.Struct("<QQQ")  # start and end of its messages, offset of the chunk
FOOTER_FIELDS = struct.Struct("<QQI")  # start of the summary, start of its offsets, checksum
UNCHUNKED_BATCH_BYTES = 1 << 22


def read_mcap(path: Path, ledger: ReadingLedger, wanted: Collection[str]) -> Iterator[MessageBlock]:
    """Yield the wanted topics' messages of one file, chunk by chunk.

    Raises:
        InputError: The file cannot be opened or is not an MCAP file.
    """
    with opened_file(path, ledger) as opened:
        if opened.file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path}: not an MCAP file (its first bytes are not MCAP's); remove it")
        for block in _Scan(opened, wanted).blocks():
            yield from decompressed_messages(block, opened.ledger)


class _Scan:
    """One pass over the data section."""

    def __init__(self, opened: OpenedFile, wanted: Collection[str]) -> None:
        self.file = opened.file
        self.size = opened.size
        self.ledger = opened.ledger
        self.wanted = wanted
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.topics: dict[int, LoggedTopic] = {}
        self.chunk_starts: list[int] = []
        self.summary_is_read = False
        self.unchunked = bytearray()  # message records outside of chunks

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield blocks until the data section, the file or its readable part ends."""
        offset = len(MAGIC)
        while True:
            prefix = self.file.read(PREFIX.size)
            if len(prefix) < PREFIX.size:
                self.ledger.damage(
                    offset, "the file ends here without MCAP's end mark; all before it was read"
                )
                break
            opcode, length = PREFIX.unpack(prefix)
            end = offset + PREFIX.size + length
            if opcode not in KNOWN_OPCODES or (end > self.size and opcode not in (CHUNK, MESSAGE)):
                following = self.next_indexed_chunk(offset)
                lost = following - offset
                self.ledger.damage(offset, f"no MCAP record stands here; {lost} bytes are lost")
                if following == self.size:
                    break
                self.file.seek(following)
                offset = following
                continue
            if opcode in (DATA_END, FOOTER):
                break
            if opcode == CHUNK:
                yield from self.chunk(offset, length)
            elif opcode == MESSAGE:
                self.unchunked += prefix + self.file.read(min(length, self.size - offset - PREFIX.size))
                if len(self.unchunked) >= UNCHUNKED_BATCH_BYTES or end > self.size:
                    yield from self.flush(offset)
            elif opcode in (SCHEMA, CHANNEL):
                self.describe(opcode, self.file.read(length), offset)
            if end > self.size:
                break
            self.file.seek(end)
            offset = end
        yield from self.flush(offset)

    def next_indexed_chunk(self, offset: int) -> int:
        """Return the next chunk's start from the file's index, or the file's size without one."""
        self.read_summary()
        return min((start for start in self.chunk_starts if offset < start < self.size), default=self.size)

    def read_summary(self) -> None:
        """Read the summary at the file's end, once: chunk offsets, and the channels' repeated descriptions.

        It is needed only if the data section is damaged.
        """
        if self.summary_is_read:
            return
        self.summary_is_read = True
        here, tail = self.file.tell(), PREFIX.size + FOOTER_FIELDS.size + len(MAGIC)
        self.file.seek(max(self.size - tail, 0))
        end = self.file.read(tail)
        if len(end) == tail and end[0] == FOOTER and end.endswith(MAGIC):
            summary_start, _, _ = FOOTER_FIELDS.unpack_from(end, PREFIX.size)
            if 0 < summary_start < self.size and self.size - summary_start < MAXIMUM_CHUNK_BYTES:
                self.file.seek(summary_start)
                self.take_summary(self.file.read(), summary_start)
        self.file.seek(here)

    def take_summary(self, summary: bytes, offset: int) -> None:
        """Walk the summary's records."""
        position = 0
        while position + PREFIX.size <= len(summary):
            opcode, length = PREFIX.unpack_from(summary, position)
            body = summary[position + PREFIX.size : position + PREFIX.size + length]
            if opcode == CHUNK_INDEX and len(body) >= CHUNK_INDEX_START.size:
                self.chunk_starts.append(CHUNK_INDEX_START.unpack_from(body)[2])
            elif opcode in (SCHEMA, CHANNEL):
                self.describe(opcode, body, offset)
            position += PREFIX.size + length

    def flush(self, offset: int) -> Iterator[MessageBlock]:
        """Yield the messages outside of chunks."""
        if self.unchunked:
            data, self.unchunked = bytes(self.unchunked), bytearray()
            yield from self.records(data, f"in the unchunked messages before byte {offset}", offset, {})

    def chunk(self, offset: int, length: int) -> Iterator[MessageBlock]:
        """Yield the blocks of the chunk record at `offset`, whose prefix was read."""
        if length > MAXIMUM_CHUNK_BYTES < self.size:
            self.ledger.damage(offset, f"the chunk declares {length} bytes; it is lost")
            return
        body = self.file.read(min(length, self.size - offset - PREFIX.size))
        cut = len(body) < length
        try:
            _, _, size, checksum, name_length = CHUNK_HEADER.unpack_from(body)
            records_start = CHUNK_HEADER.size + name_length + 8
            compression = body[CHUNK_HEADER.size : records_start - 8].decode("ascii")
            (stated,) = struct.unpack_from("<Q", body, records_start - 8)
        except (struct.error, UnicodeDecodeError):
            self.ledger.damage(offset, "the chunk's header is damaged; the chunk is lost")
            return
        records = body[records_start : records_start + stated]
        try:
            data = decompress(compression, records, size, cut or len(records) < stated)
        except DecompressionError as error:
            self.ledger.damage(offset, f"the chunk cannot be decompressed ({error}); the chunk is lost")
            return
        if cut:
            self.ledger.damage(
                offset, f"the file ends within this chunk; {len(data)} of its {size} bytes were read"
            )
        elif checksum and zlib.crc32(data) != checksum:
            self.ledger.damage(offset, f"the chunk's checksum fails; the chunk ({size} bytes) is lost")
            return
        indexes = {} if cut else self.message_indexes(offset + PREFIX.size + length)
        yield from self.records(data, "in the chunk that starts here", offset, indexes)

    def message_indexes(self, position: int) -> dict[int, np.ndarray]:
        """Read the message index records that follow a chunk."""
        indexes: dict[int, np.ndarray] = {}
        self.file.seek(position)
        while len(prefix := self.file.read(PREFIX.size)) == PREFIX.size:
            opcode, length = PREFIX.unpack(prefix)
            if opcode != MESSAGE_INDEX or length > self.size:
                break
            body = self.file.read(length)
            if len(body) < INDEX_HEADER.size:
                break
            channel, n_bytes = INDEX_HEADER.unpack_from(body)
            if channel in indexes or n_bytes % ENTRY_BYTES or INDEX_HEADER.size + n_bytes > len(body):
                return {}
            if n_bytes:
                words = np.frombuffer(body, "<u8", n_bytes // ENTRY_BYTES * ENTRY_WORDS, INDEX_HEADER.size)
                indexes[channel] = words.reshape(-1, ENTRY_WORDS)
        return indexes

    def records(
        self, data: bytes, place: str, offset: int, indexes: dict[int, np.ndarray]
    ) -> Iterator[MessageBlock]:
        """Find message, schema and channel records and yield one block per wanted channel."""

        def walk(begin: int, end: int, columns: BlockColumns) -> int:
            return self.walk(data, begin, end, columns, offset)

        buffer = np.frombuffer(data, np.uint8)
        indexed = find_messages(buffer, indexes)
        columns, lost = gather_records(BlockColumns(buffer), len(data), indexed, walk, self.ledger)
        if lost:
            self.ledger.damage(offset, f"{place}, {describe_loss(lost, len(data))}")
        if not columns.channels <= self.topics.keys():
            self.read_summary()
        yield from columns.blocks(self.topics, self.ledger, self.wanted, offset)

    def walk(self, data: bytes, position: int, end: int, columns: BlockColumns, offset: int) -> int:
        """Walk the records of a stretch of a chunk; return its end, or the start of a damaged record."""
        unpack = MESSAGE_HEADER.unpack_from
        while position + PREFIX.size <= end:
            if data[position] == MESSAGE and position + MESSAGE_HEADER.size <= end:
                _, length, channel, _, log_time, _ = unpack(data, position)
                following = position + PREFIX.size + length
                if following > end or length < MESSAGE_FIELDS:
                    break
                columns.add(channel, log_time, position + MESSAGE_HEADER.size, length - MESSAGE_FIELDS)
            else:
                opcode, length = PREFIX.unpack_from(data, position)
                following = position + PREFIX.size + length
                if opcode not in KNOWN_OPCODES or opcode == MESSAGE or following > end:
                    break
                if opcode in (SCHEMA, CHANNEL):
                    self.describe(opcode, data[position + PREFIX.size : following], offset)
            position = following
        return position

    def describe(self, opcode: int, body: bytes, offset: int) -> None:
        """Read a schema or channel record."""
        try:
            if opcode == SCHEMA:
                (number,) = struct.unpack_from("<H", body)
                name, position = _string(body, 2)
                encoding, position = _string(body, position)
                text, _ = _string(body, position, BYTES_AS_TEXT if encoding in BINARY_SCHEMAS else "utf-8")
                self.schemas[number] = (name, encoding, text)
            else:
                number, schema = struct.unpack_from("<HH", body)
                name, position = _string(body, 4)
                encoding, _ = _string(body, position)
                type_name, definition_format, text = self.schemas.get(schema, ("", "", ""))
                topic = LoggedTopic(name, full_type_name(type_name), encoding, text, definition_format)
                self.topics[number] = topic
                self.ledger.add_topic(topic)
        except (struct.error, UnicodeDecodeError, IndexError):
            self.ledger.damage(offset, "the description of a channel is damaged")


def _string(body: bytes, position: int, encoding: str = "utf-8") -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, position)
    end = position + 4 + length
    if end > len(body):
        raise IndexError(end)
    return body[position + 4 : end].decode(encoding), end
