"""Read MCAP files, intact or damaged (mcap.dev/spec).

The data section is read front to back, chunk by chunk, so a file without summary, index or end is read up to its last
byte. A chunk whose checksum fails is dropped completely, because the wrong bytes are unknown. The front of a truncated
chunk is used. The number of messages is held against the file's statistics, or against the chunks' indexes.

User time for 756,000 messages in 103 MB: 0.14 to 0.21 s; with the `mcap` library, read in blocks, 10.0 to 10.8 s
(`benchmarks.log_readers`). Of a file cut in half the library's indexed reader gives nothing; behind a chunk that cannot
be decompressed neither of its readers gives anything.
"""

import struct
import zlib
from collections.abc import Container, Iterator
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.compression.bounded_decompression import (
    MAXIMUM_CHUNK_BYTES,
    DecompressionError,
    decompress,
)
from pipeline.logs.formats.compression.message_compression import decompressed_messages
from pipeline.logs.formats.indexed_chunk import describe_loss, gather_records, record_budget
from pipeline.logs.formats.mcap.index import ENTRY_WORDS, find_messages
from pipeline.logs.formats.mcap.summary import (
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    MAGIC,
    MAXIMUM_DESCRIPTION_BYTES,
    MESSAGE,
    MESSAGE_INDEX,
    PREFIX,
    SCHEMA,
    Summary,
)
from pipeline.logs.formats.opened_file import OpenedFile, opened_file
from pipeline.logs.messages.decoding.definitions import full_type_name
from pipeline.logs.messages.message_blocks import (
    BYTES_AS_TEXT,
    BlockColumns,
    LoggedTopic,
    MessageBlock,
    ReadingLedger,
)

BINARY_SCHEMAS = ("protobuf", "flatbuffer")
MESSAGE_HEADER = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
MESSAGE_FIELDS = MESSAGE_HEADER.size - PREFIX.size
CHUNK_HEADER = struct.Struct("<QQQII")  # start, end, size when decompressed, checksum, length of a name
INDEX_HEADER = struct.Struct("<HI")  # channel, length of its entries in bytes
ENTRY_BYTES = 8 * ENTRY_WORDS
DATA_END_BYTES = 4
SPECIFIED_OPCODES = range(1, 16)
UNCHUNKED_BATCH_BYTES = 1 << 22
MAXIMUM_UNCHUNKED_BYTES = 1 << 27  # of a message outside of chunks


def read_mcap(path: Path, ledger: ReadingLedger, wanted: Container[str]) -> Iterator[MessageBlock]:
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

    def __init__(self, opened: OpenedFile, wanted: Container[str]) -> None:
        self.file = opened.file
        self.size = opened.size
        self.ledger = opened.ledger
        self.wanted = wanted
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.topics: dict[int, LoggedTopic] = {}
        self.summary = Summary(opened.file, opened.size)
        self.unchunked = bytearray()  # message records outside of chunks
        self.n_found = self.n_indexed = self.n_found_indexed = 0  # messages
        self.indexes_end = 0  # of the records that index the last chunk

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield blocks until the data section, the file or its readable part ends."""
        offset, is_ended = len(MAGIC), False
        while offset < self.size and not is_ended:
            self.file.seek(offset)
            prefix = self.file.read(PREFIX.size)
            if len(prefix) < PREFIX.size:
                break
            opcode, length = self.repaired(offset, *PREFIX.unpack(prefix))
            end = offset + PREFIX.size + length
            swallowed = self.summary.next_chunk(offset, min(end, self.size))
            is_cut = end > self.size
            if opcode == 0 or swallowed or (is_cut and opcode != CHUNK):
                following = swallowed or self.summary.next_chunk(offset) or self.size
                self.ledger.damage(offset, f"no MCAP record stands here; {following - offset} bytes are lost")
                offset, is_ended = following, following == self.size
                continue
            self.file.seek(offset + PREFIX.size)
            if opcode == CHUNK:
                yield from self.chunk(offset, length)
                end = max(end, self.indexes_end)
            elif opcode == MESSAGE_INDEX and length >= INDEX_HEADER.size:  # of a chunk that was not read
                _, n_bytes = INDEX_HEADER.unpack(self.file.read(INDEX_HEADER.size))
                self.n_indexed += n_bytes // ENTRY_BYTES
            elif opcode == MESSAGE:
                yield from self.message(prefix, offset, length)
            elif opcode in (SCHEMA, CHANNEL):
                self.describe(opcode, self.file.read(min(length, MAXIMUM_DESCRIPTION_BYTES)), offset)
            elif (opcode, length) == (DATA_END, DATA_END_BYTES):
                is_ended = self.summary.next_chunk(offset) is None
            offset = end
            is_ended |= is_cut or (opcode == FOOTER and end == self.size - len(MAGIC))
        yield from self.flush(offset)
        if not is_ended:
            self.ledger.damage(offset, "the file ends here without MCAP's end mark; all before it was read")
        self.compare()

    def repaired(self, offset: int, opcode: int, length: int) -> tuple[int, int]:
        """Return a record's opcode and length; where one of them is damaged in a chunk, as the index states it."""
        stated = self.summary.chunk_lengths.get(offset, 0) - PREFIX.size
        if opcode != CHUNK and length == stated:
            self.ledger.damage(offset, f"the record's opcode {opcode} is damaged; the index has a chunk here")
        elif opcode == CHUNK and length != stated > 0 and self.is_followed(offset, stated):
            if self.is_followed(offset, length):
                return opcode, length
            self.ledger.damage(offset, f"the chunk's length {length} is damaged; the index states {stated}")
        else:
            return opcode, length
        return CHUNK, stated

    def is_followed(self, offset: int, length: int) -> bool:
        """Return whether another record stands behind that of a given length."""
        following = offset + PREFIX.size + length
        if following > self.size:
            return False
        self.file.seek(following)
        prefix = self.file.read(PREFIX.size)
        if len(prefix) < PREFIX.size:
            return False
        opcode, length = PREFIX.unpack(prefix)
        return opcode in SPECIFIED_OPCODES and following + PREFIX.size + length <= self.size

    def compare(self) -> None:
        """Hold the number of messages against what the file states."""
        if self.summary.n_messages is not None:
            self.ledger.compare_counts("its statistics state", self.summary.n_messages, self.n_found)
        elif self.n_found_indexed < self.n_indexed:
            self.ledger.compare_counts("its chunks' indexes list", self.n_indexed, self.n_found_indexed)

    def message(self, prefix: bytes, offset: int, length: int) -> Iterator[MessageBlock]:
        """Take the message record at `offset`, which stands outside of chunks."""
        if length > MAXIMUM_UNCHUNKED_BYTES:
            self.ledger.damage(offset, f"the message declares {length} bytes; it is lost")
            return
        self.unchunked += prefix + self.file.read(length)
        if len(self.unchunked) >= UNCHUNKED_BATCH_BYTES:
            yield from self.flush(offset)

    def flush(self, offset: int) -> Iterator[MessageBlock]:
        """Yield the messages outside of chunks."""
        if self.unchunked:
            data, self.unchunked = bytes(self.unchunked), bytearray()
            place = f"in the unchunked messages before byte {offset}"
            yield from self.records(data, place, offset, {}, len(data))

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
        yield from self.records(data, "in the chunk that starts here", offset, indexes, len(records))

    def message_indexes(self, position: int) -> dict[int, np.ndarray]:
        """Read the message index records that follow a chunk."""
        indexes: dict[int, np.ndarray] = {}
        are_sound = True
        self.file.seek(position)
        while len(prefix := self.file.read(PREFIX.size)) == PREFIX.size:
            opcode, length = PREFIX.unpack(prefix)
            following = position + PREFIX.size + length
            if opcode != MESSAGE_INDEX or following > self.size or self.summary.has_chunk(position):
                break
            self.file.seek(position + PREFIX.size)
            body = self.file.read(length)
            if len(body) < INDEX_HEADER.size:
                break
            channel, n_bytes = INDEX_HEADER.unpack_from(body)
            if channel in indexes or n_bytes % ENTRY_BYTES or INDEX_HEADER.size + n_bytes > len(body):
                are_sound = False
            elif n_bytes:
                words = np.frombuffer(body, "<u8", n_bytes // ENTRY_BYTES * ENTRY_WORDS, INDEX_HEADER.size)
                indexes[channel] = words.reshape(-1, ENTRY_WORDS)
            position = following
        self.indexes_end = position
        return indexes if are_sound else {}

    def records(
        self, data: bytes, place: str, offset: int, indexes: dict[int, np.ndarray], n_stored_bytes: int
    ) -> Iterator[MessageBlock]:
        """Find message, schema and channel records and yield one block per wanted topic."""
        budget = record_budget(n_stored_bytes)

        def walk(begin: int, end: int, columns: BlockColumns) -> int:
            return self.walk(data, begin, end, columns, offset, budget)

        columns = BlockColumns(np.frombuffer(data, np.uint8))
        lost = gather_records(columns, len(data), find_messages(columns.data, indexes), walk, self.ledger)
        if lost:
            self.ledger.damage(offset, f"{place}, {describe_loss(lost, len(data))}")
        self.n_found += len(columns)
        if indexes:
            self.n_indexed += sum(map(len, indexes.values()))
            self.n_found_indexed += len(columns)
        if not columns.channels <= self.topics.keys():
            for opcode, place_described, body in self.summary.descriptions:
                self.describe(opcode, body, place_described)
            self.summary.descriptions.clear()
        yield from columns.blocks(self.topics, self.ledger, self.wanted, offset)

    def walk(
        self, data: bytes, position: int, end: int, columns: BlockColumns, offset: int, budget: Iterator[int]
    ) -> int:
        """Walk the records of a stretch of a chunk; return its end, or the start of a damaged record."""
        unpack = MESSAGE_HEADER.unpack_from
        for _ in budget:
            if position + PREFIX.size > end:
                break
            if data[position] == MESSAGE and position + MESSAGE_HEADER.size <= end:
                _, length, channel, _, log_time, _ = unpack(data, position)
                following = position + PREFIX.size + length
                if following > end or length < MESSAGE_FIELDS:
                    break
                columns.add(channel, log_time, position + MESSAGE_HEADER.size, length - MESSAGE_FIELDS)
            else:
                opcode, length = PREFIX.unpack_from(data, position)
                following = position + PREFIX.size + length
                if opcode in (0, MESSAGE) or following > end:
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
