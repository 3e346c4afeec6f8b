"""Messages in Protobuf, as Foxglove's tools record them in MCAP files, with the `protobuf` library.

The schema of a channel is a serialised `FileDescriptorSet`.
"""

import functools
import math
from collections.abc import Collection, Iterator, Mapping
from graphlib import TopologicalSorter
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, Message
from google.protobuf.message_factory import GetMessageClass

from pipeline.errors import first_line
from pipeline.logs.messages.decoding.definitions import MAXIMUM_DEFINITION_CHARACTERS, DefinitionError
from pipeline.logs.messages.decoding.field_paths import Step, steps_of
from pipeline.logs.messages.decoding.layout import FieldGroup
from pipeline.logs.messages.decoding.trees import TreeError, decode_trees
from pipeline.logs.messages.message_blocks import BYTES_AS_TEXT, LoggedTopic, MessageBlock


def decode_protobuf(block: MessageBlock, wanted: Collection[str]) -> tuple[list[FieldGroup], np.ndarray]:
    """Decode the wanted fields. An optional number that is not set is not a number; others are zero.

    Raises:
        DefinitionError: The channel's schema cannot be used.
    """
    names = frozenset(step for path in wanted for step in steps_of(path) if isinstance(step, str))
    message_class = message_class_of(block.topic, names)

    def parse(message: bytes) -> Message:
        try:
            return message_class.FromString(message)
        except DecodeError as error:
            raise TreeError(str(error)) from error

    return decode_trees(block, wanted, parse, protobuf_child)


@functools.lru_cache(maxsize=64)
def message_class_of(topic: LoggedTopic, names: frozenset[str] | None = None) -> type[Message]:
    """Return the class of a topic's messages, with fields of these names alone (default: with all).

    Memory of a message grows with all fields of its class for each of its elements, also of those that are not set.

    Raises:
        DefinitionError: The schema cannot be used.
    """
    type_name, definition = topic.type_name, topic.definition
    if len(definition) > MAXIMUM_DEFINITION_CHARACTERS:
        raise DefinitionError(f"definition of {type_name} has {len(definition)} bytes")
    pool = DescriptorPool()
    try:
        files = FileDescriptorSet.FromString(definition.encode(BYTES_AS_TEXT))
        for file in _in_order_of_dependence(files):
            if names is not None:
                for message in file.message_type:
                    _leave_only(names, message)
            pool.Add(file)  # type: ignore[attr-defined, no-untyped-call]
        return GetMessageClass(pool.FindMessageTypeByName(type_name))  # type: ignore[no-untyped-call]
    except (DecodeError, TypeError, ValueError, KeyError, RecursionError) as error:
        reason = first_line(error)
        raise DefinitionError(f"definition of {type_name} cannot be used ({reason})") from error


def _leave_only(names: Collection[str], message: DescriptorProto) -> None:
    """Remove all other fields from a message's description, and from those within."""
    if not message.options.map_entry:
        kept = [field for field in message.field if field.name in names]
        choices = sorted({field.oneof_index for field in kept if field.HasField("oneof_index")})
        for field in kept:
            if field.HasField("oneof_index"):
                field.oneof_index = choices.index(field.oneof_index)
        oneofs = [message.oneof_decl[number] for number in choices]
        del message.field[:], message.oneof_decl[:]
        message.field.extend(kept)
        message.oneof_decl.extend(oneofs)
    for nested in message.nested_type:
        _leave_only(names, nested)


def _in_order_of_dependence(files: FileDescriptorSet) -> Iterator[FileDescriptorProto]:
    """The files, each behind those that it imports. Raises `CycleError`, a `ValueError`."""
    by_name = {file.name: file for file in files.file}
    order = TopologicalSorter({name: file.dependency for name, file in by_name.items()}).static_order()
    return (by_name[name] for name in order if name in by_name)


def protobuf_child(value: Any, step: Step) -> Any:
    """The value at a step."""
    if isinstance(value, Message):
        field = value.DESCRIPTOR.fields_by_name.get(step)
        if field is None:
            return None
        if field.has_presence and field.message_type is None and not value.HasField(field.name):
            return math.nan
        return getattr(value, field.name)
    if isinstance(value, str | bytes):
        return None
    try:
        return (
            value.get(step) if isinstance(value, Mapping) else value[step]
        )  # a map adds what `[]` does not find
    except (IndexError, TypeError):
        return None
