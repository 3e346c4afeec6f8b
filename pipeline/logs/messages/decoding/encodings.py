"""Decode blocks of messages of every encoding."""

from collections.abc import Collection

import numpy as np

from pipeline.logs.messages.decoding.definitions import parse_definition
from pipeline.logs.messages.decoding.json_messages import decode_json
from pipeline.logs.messages.decoding.layout import FieldGroup, decode_block
from pipeline.logs.messages.message_blocks import MessageBlock
from pipeline.logs.messages.mismatch import MismatchError

ENCODINGS = ("cdr", "ros1", "json", "protobuf")


def decode(block: MessageBlock, wanted: Collection[str]) -> tuple[list[FieldGroup], np.ndarray]:
    """Decode the wanted fields of a block.

    Returns:
        Groups of messages that are alike, and the indices of malformed messages, shape (n_malformed,).

    Raises:
        DefinitionError: The type's definition cannot be used.
        MismatchError: The encoding is not read.
    """
    topic = block.topic
    if topic.encoding == "json":
        return decode_json(block, wanted)
    if topic.encoding == "protobuf":
        from pipeline.logs.messages.decoding.protobuf_messages import (
            decode_protobuf,  # others need not wait for protobuf
        )

        return decode_protobuf(block, wanted)
    if topic.encoding not in ENCODINGS:
        raise MismatchError(f"their encoding `{topic.encoding}` is not one of {', '.join(ENCODINGS)}")
    definitions = parse_definition(topic.type_name, topic.definition, topic.definition_format)
    return decode_block(block, definitions, wanted)
