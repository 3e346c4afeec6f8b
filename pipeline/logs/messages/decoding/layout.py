"""Layout of a serialised message, and decoding of many messages of one layout at once.

A message's layout follows from its type and from its length words (of strings and sequences) alone. So one
message is walked field by field. Every other message of the block with the same length and length words is decoded with
array operations at the same offsets. The result is bit for bit that of walking each message.

Serialisations: ROS 2's XCDR1 (OMG Common Data Representation, formal/02-06-51, primitives aligned to their
size from the byte after the four-byte encapsulation header) and ROS 1's packed form (wiki.ros.org/msg).
"""

import struct
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from pipeline.logs.messages.decoding.definitions import Definitions, Field, Repetition
from pipeline.logs.messages.message_blocks import MessageBlock
from pipeline.logs.messages.mismatch import MismatchError

ENCAPSULATION_BYTES = 4
XCDR1_ENCAPSULATIONS = (0, 1)  # plain CDR, big-endian and little-endian
XCDR2_ENCAPSULATIONS = range(6, 12)  # OMG DDS-XTypes 1.3, table 60
MAXIMUM_NESTING = 32
MAXIMUM_FIELDS = 1_000_000  # per message; nested definitions can grow without taking bytes
MAXIMUM_SHARED_LAYOUTS = 8  # per block; messages of further layouts are walked one by one

NUMBER_TYPES = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
ROS1_NUMBER_TYPES = NUMBER_TYPES | {"byte": "i1"}  # a deprecated name of int8 there


class LayoutError(Exception):
    """A message does not fit its definition, or a definition lacks a field."""


class TooManyFieldsError(LayoutError, MismatchError):
    """A message has so many fields that walking them takes seconds."""


@dataclass(frozen=True)
class Span:
    """Numbers in a message: `count` of `dtype` (NumPy notation with byte order) from byte `offset` on."""

    offset: int
    dtype: str
    count: int


@dataclass
class Layout:
    """Offsets of the wanted fields of a message.

    Attributes:
        length: Length of the message in bytes.
        numbers: Wanted number fields by path (`header.stamp.sec`, `position`, `points[0].velocities`).
        strings: Wanted string fields by path, one (offset, length) per element.
        length_words: Spans whose values determine the layout.
    """

    length: int
    numbers: dict[str, Span] = field(default_factory=dict)
    strings: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    length_words: list[Span] = field(default_factory=list)


@dataclass(frozen=True)
class FieldGroup:
    """Decoded fields of the messages of a block that share a layout and the values of the wanted strings.

    Attributes:
        index: Which messages of the block, shape (n,), ascending.
        numbers: By path, shape (n, count), in the message's own number type.
        strings: By path, the elements (equal for all messages of the group).
    """

    index: np.ndarray
    numbers: dict[str, np.ndarray]
    strings: dict[str, tuple[str, ...]]

    def number(self, path: str) -> np.ndarray:
        """Return a scalar number field, shape (n,).

        Raises:
            LayoutError: The messages have no such field, or it holds several values.
        """
        values = self.sequence(path)
        if values.shape[1] != 1:
            raise LayoutError(f"their field `{path}` holds {values.shape[1]} values, not one")
        return values[:, 0]

    def sequence(self, path: str) -> np.ndarray:
        """Return a number field, shape (n, count).

        Raises:
            LayoutError: The messages have no such field.
        """
        if path not in self.numbers:
            raise LayoutError(f"they have no number field `{path}`")
        return self.numbers[path]

    def text(self, path: str) -> tuple[str, ...]:
        """Return the elements of a string field.

        Raises:
            LayoutError: The messages have no such field.
        """
        if path not in self.strings:
            raise LayoutError(f"they have no text field `{path}`")
        return self.strings[path]


def layout_of(
    message: bytes, definitions: Definitions, type_name: str, encoding: str, wanted: Collection[str]
) -> Layout:
    """Walk one message and return the layout of its wanted fields.

    Raises:
        LayoutError: The message does not fit the definition.
    """
    if not message:
        raise LayoutError("the message has no bytes")
    walker = _Walker(message, definitions, encoding, wanted)
    walker.walk(type_name, "", 0)
    return walker.layout


def decode_block(
    block: MessageBlock, definitions: Definitions, wanted: Collection[str]
) -> tuple[list[FieldGroup], np.ndarray]:
    """Decode the wanted fields of a block of messages of one type.

    Args:
        definitions: Their type and all nested types.
        wanted: Paths of number and string fields.

    Returns:
        Groups of messages of one layout, and the indices of malformed messages, shape (n_malformed,).

    Raises:
        MismatchError: The messages are XCDR2, which aligns and delimits fields in another way, or have too many fields.
    """
    if block.topic.encoding == "cdr" and len(block.start) and block.length[0] >= ENCAPSULATION_BYTES:
        kind = int.from_bytes(block.data[block.start[0] : block.start[0] + 2].tobytes())
        if kind in XCDR2_ENCAPSULATIONS:
            raise MismatchError(f"they are XCDR2 (encapsulation {kind:#06x}), and only XCDR1 is read")
    remaining = np.arange(len(block.start))
    groups: list[FieldGroup] = []
    malformed: list[int] = []
    while len(remaining):
        first = int(remaining[0])
        begin, length = int(block.start[first]), int(block.length[first])
        message = block.data[begin : begin + length].tobytes()
        try:
            layout = layout_of(message, definitions, block.topic.type_name, block.topic.encoding, wanted)
        except TooManyFieldsError:
            raise
        except LayoutError:
            malformed.append(first)
            remaining = remaining[1:]
            continue
        candidates = remaining if len(groups) < MAXIMUM_SHARED_LAYOUTS else remaining[:1]
        candidates = candidates[block.length[candidates] == length]
        index, numbers = _decode_alike(block, candidates, layout, message)
        groups.append(FieldGroup(index, numbers, _strings(layout, message)))
        remaining = remaining[1:] if len(index) == 1 else np.setdiff1d(remaining, index, assume_unique=True)
    return groups, np.array(malformed, dtype=np.int64)


def structured_view(layout: Layout) -> np.dtype:
    """Return the structured type that maps the wanted numbers of a layout."""
    paths = list(layout.numbers)
    spans = [layout.numbers[path] for path in paths]
    return np.dtype(
        {
            "names": paths,
            "formats": [(span.dtype, (span.count,)) for span in spans],
            "offsets": [span.offset for span in spans],
            "itemsize": layout.length,
        }
    )


def _decode_alike(
    block: MessageBlock, candidates: np.ndarray, layout: Layout, message: bytes
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Stack the candidates; keep those with the first one's length words and wanted strings."""
    length = layout.length
    overlapping = np.ndarray(
        (len(block.data) - length + 1,), dtype=f"V{length}", buffer=block.data, strides=(1,)
    )
    rows = overlapping[block.start[candidates]].view(np.uint8).reshape(len(candidates), length)
    guarded = np.zeros(length, dtype=bool)
    for span in layout.length_words:
        guarded[span.offset : span.offset + np.dtype(span.dtype).itemsize] = True
    for places in layout.strings.values():
        for offset, n_bytes in places:
            guarded[offset : offset + n_bytes] = True
    columns = np.flatnonzero(guarded)
    alike = (rows[:, columns] == np.frombuffer(message, np.uint8)[columns]).all(axis=1)
    if not alike.all():
        rows, candidates = np.ascontiguousarray(rows[alike]), candidates[alike]
    table = rows.view(structured_view(layout)).reshape(len(candidates))
    return candidates, {path: table[path] for path in layout.numbers}


def _strings(layout: Layout, message: bytes) -> dict[str, tuple[str, ...]]:
    return {
        path: tuple(message[offset : offset + n_bytes].decode(errors="replace") for offset, n_bytes in places)
        for path, places in layout.strings.items()
    }


class _Walker:
    """Walks one message along its definition."""

    def __init__(
        self, message: bytes, definitions: Definitions, encoding: str, wanted: Collection[str]
    ) -> None:
        self.message = message
        self.definitions = definitions
        self.aligned = encoding == "cdr"
        self.number_types = NUMBER_TYPES if self.aligned else ROS1_NUMBER_TYPES
        self.prefixes = {path[:end] for path in wanted for end in _prefix_ends(path)}
        self.layout = Layout(length=len(message))
        self.origin = self.position = self.n_fields = 0
        self.order = "<"
        if self.aligned:
            if (
                len(message) < ENCAPSULATION_BYTES
                or message[0] != 0
                or message[1] not in XCDR1_ENCAPSULATIONS
            ):
                raise LayoutError("no plain CDR encapsulation")
            self.order = "<" if message[1] else ">"
            self.layout.length_words.append(Span(0, "u2", 1))  # the byte order determines the layout, too
            self.origin = self.position = ENCAPSULATION_BYTES

    def walk(self, type_name: str, path: str, depth: int) -> None:
        """Walk a message of a type from the present position on."""
        if depth > MAXIMUM_NESTING:
            raise LayoutError(f"{type_name} nests deeper than {MAXIMUM_NESTING}")
        fields = self.definitions[type_name]
        if not fields and self.aligned:
            self.take(1)  # ROS 2 gives empty messages one byte
        for entry in fields:
            self.walk_field(entry, f"{path}{entry.name}", depth)

    def walk_field(self, entry: Field, path: str, depth: int) -> None:
        """Walk one field: a scalar, an array or a sequence."""
        self.n_fields += 1
        if self.n_fields > MAXIMUM_FIELDS:
            raise TooManyFieldsError(f"one of them has more than {MAXIMUM_FIELDS} fields")
        count = self.length_word() if entry.repetition is Repetition.sequence else entry.length
        repeated = entry.repetition is not Repetition.once
        if not entry.is_primitive:
            self.walk_messages(entry.type_name, path, count, repeated, depth)
        elif entry.type_name == "string":
            self.walk_strings(path, count)
        elif entry.type_name in self.number_types:
            dtype = self.order + self.number_types[entry.type_name]
            size = np.dtype(dtype).itemsize
            offset = self.take(size * count, alignment=size if count else 1)
            if path in self.prefixes:
                self.layout.numbers[path] = Span(offset, dtype, count)
        else:
            raise LayoutError(f"{path} is of type {entry.type_name}, which cannot be decoded")

    def walk_messages(self, type_name: str, path: str, count: int, repeated: bool, depth: int) -> None:
        """Walk nested messages."""
        if not self.definitions[type_name]:
            self.take(count if self.aligned else 0)  # ROS 2 gives empty messages one byte
            return
        for number in range(count):
            element = f"{path}[{number}]" if repeated else path
            before = self.position
            self.walk(type_name, f"{element}.", depth + 1)
            if self.position == before:
                return  # a ROS 1 message without bytes, such as one of empty messages: any number of them has none

    def walk_strings(self, path: str, count: int) -> None:
        """Walk strings; CDR counts their terminating zero."""
        places = []
        for _ in range(count):
            n_bytes = self.length_word()
            offset = self.take(n_bytes)
            places.append((offset, max(n_bytes - 1, 0) if self.aligned else n_bytes))
        if path in self.prefixes:
            self.layout.strings[path] = places

    def length_word(self) -> int:
        """Read a length, which determines the layout."""
        offset = self.take(4, alignment=4)
        self.layout.length_words.append(Span(offset, self.order + "u4", 1))
        return struct.unpack_from(self.order + "I", self.message, offset)[0]

    def take(self, n_bytes: int, alignment: int = 1) -> int:
        """Advance over bytes and return their start."""
        if self.aligned:
            self.position += -(self.position - self.origin) % alignment
        start = self.position
        if start + n_bytes > len(self.message):
            raise LayoutError(f"needs byte {start + n_bytes} of {len(self.message)}")
        self.position = start + n_bytes
        return start


def _prefix_ends(path: str) -> list[int]:
    """Ends of the prefixes of a path that may name the field: the path's end, and before a final index (`data[3]`)."""
    return [len(path)] + ([path.rindex("[")] if path.endswith("]") else [])
