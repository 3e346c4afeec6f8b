"""Add what a bag holds to the contents of a folder."""

import numpy as np

from pipeline.errors import counted
from pipeline.logs.describe.contents import MAXIMUM_ELEMENTS, Contents, Stream
from pipeline.logs.describe.field_types import TEXT, TIME, field_types
from pipeline.logs.formats.bags import readable_blocks
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.messages.decoding.definitions import DefinitionError
from pipeline.logs.messages.decoding.encodings import decode
from pipeline.logs.messages.decoding.layout import LayoutError
from pipeline.logs.messages.joint_states import FOXGLOVE_NAMES, FOXGLOVE_TYPE
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock, ReadingLedger
from pipeline.logs.messages.mismatch import MismatchError

MAXIMUM_MESSAGE_BYTES = 1 << 14  # longer ones (images, point clouds) hold no joint states
NAMES = ("name", FOXGLOVE_NAMES)
FOXGLOVE_FIELDS = {
    FOXGLOVE_NAMES: f"{TEXT}[]",
    "joints[].position": "number[]",
    "joints[].velocity": "number[]",
}


class _EveryTopic:
    """Wanted topics: all."""

    def __contains__(self, _: object) -> bool:
        return True


def add_bag(entry: LogEntry, contents: Contents) -> None:
    """Add the topics of a bag, with the ranges of all their numbers.

    Raises:
        InputError: The bag cannot be read.
    """
    ledger = ReadingLedger(entry.path)
    for note in entry.notes:
        ledger.notes.append(note)
    for block in readable_blocks(entry, ledger, _EveryTopic()):
        stream = _stream(block.topic, contents)
        stream.add_times(block.log_time_ns)
        _add_block(block, stream)
    for topics in ledger.topics.values():
        for topic in topics:
            _stream(topic, contents).end_log()
    contents.add_log(f"{entry.path}: {counted(sum(ledger.counts.values()), 'message')}", ledger.notes)


def _stream(topic: LoggedTopic, contents: Contents) -> Stream:
    key = (topic.name, topic.type_name)
    return contents.stream(key, *key)


def _add_block(block: MessageBlock, stream: Stream) -> None:
    if stream.note or not len(block.start):
        return
    if block.length.max() > MAXIMUM_MESSAGE_BYTES:
        stream.note = f"messages of {block.length.max()} bytes: not looked into"
        return
    try:
        if not stream.fields:
            first = block.data[block.start[0] : block.start[0] + block.length[0]].tobytes()
            stream.add_fields(field_types(block.topic, first))
            if block.topic.type_name == FOXGLOVE_TYPE:
                stream.add_fields(FOXGLOVE_FIELDS)
        # single texts differ from message to message, and would be decoded one by one
        wanted = [path for path, content in stream.fields.items() if content.type_name not in (TIME, TEXT)]
        groups, _ = decode(block, wanted)
    except (MismatchError, DefinitionError, LayoutError) as reason:
        stream.note = str(reason)
        return
    for group in groups:
        names = next((group.strings[path] for path in NAMES if path in group.strings), ())
        for path, texts in group.strings.items():
            if path in stream.fields:
                stream.fields[path].add_texts(texts)
        for path, values in group.numbers.items():
            if path in stream.fields:
                stream.fields[path].add_numbers(_by_name(values, names, stream))


def _by_name(values: np.ndarray, names: tuple[str, ...], stream: Stream) -> np.ndarray:
    """Values of named joints in the order in which the stream first named them, shape (n, n_names)."""
    if len(names) < 2 or values.shape[1] != len(names):
        return values
    for name in names:
        if len(stream.names) < MAXIMUM_ELEMENTS:
            stream.names.setdefault(name, len(stream.names))
    places = {stream.names[name]: number for number, name in enumerate(names) if name in stream.names}
    ordered = np.full((len(values), len(stream.names)), np.nan)
    ordered[:, list(places)] = values[:, list(places.values())]
    return ordered
