"""Fields of a topic's messages, by path, whatever the encoding."""

from collections.abc import Iterator
from typing import Any

from pipeline.logs.messages.decoding.definitions import Definitions, Repetition, parse_definition
from pipeline.logs.messages.decoding.json_messages import parse_json
from pipeline.logs.messages.decoding.layout import NUMBER_TYPES
from pipeline.logs.messages.decoding.protobuf_messages import message_class_of
from pipeline.logs.messages.decoding.trees import TreeError
from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.mismatch import MismatchError

TIME, TEXT = "time", "text"
MAP = "map"  # its entries' paths are `map.KEY`
ROS_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
PROTOBUF_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")
ARRAY_LAYOUT = "std_msgs/msg/MultiArrayLayout"  # which nobody fills in
MAXIMUM_FIELDS = 64  # of a type
MAXIMUM_DEPTH = 6


def field_types(topic: LoggedTopic, message: bytes) -> dict[str, str]:
    """Return the types of a topic's fields by path; of a list of messages only the first one's.

    Args:
        message: Its first message.

    Raises:
        DefinitionError: The definition cannot be used.
        MismatchError: The encoding is not read, or the message cannot be parsed.
    """
    if topic.encoding == "json":
        try:
            found = _of_json(parse_json(message), "", 0)
        except TreeError as error:
            raise MismatchError("they are not JSON") from error
    elif topic.encoding == "protobuf":
        found = _of_protobuf(message_class_of(topic).DESCRIPTOR, "", 0)
    elif topic.encoding in ("cdr", "ros1"):
        definitions = parse_definition(topic.type_name, topic.definition, topic.definition_format)
        found = _of_ros(topic.type_name, definitions, "", 0)
    else:
        raise MismatchError(f"their encoding `{topic.encoding}` is not read")
    return dict(pair for pair, _ in zip(found, range(MAXIMUM_FIELDS), strict=False))


def _of_ros(type_name: str, definitions: Definitions, prefix: str, depth: int) -> Iterator[tuple[str, str]]:
    for entry in definitions[type_name] if depth < MAXIMUM_DEPTH else ():
        if entry.type_name == ARRAY_LAYOUT:
            continue
        path, is_list = f"{prefix}{entry.name}", entry.repetition is not Repetition.once
        marks = {Repetition.once: "", Repetition.sequence: "[]", Repetition.array: f"[{entry.length}]"}
        if entry.is_primitive and entry.type_name in NUMBER_TYPES:
            yield path, entry.type_name + marks[entry.repetition]
        elif entry.is_primitive:
            yield path, TEXT + marks[entry.repetition]
        elif entry.type_name in ROS_TIMES:
            yield path, TIME
        else:
            inside = f"{path}[0]." if is_list else f"{path}."
            yield from _of_ros(entry.type_name, definitions, inside, depth + 1)


def _of_json(value: Any, path: str, depth: int) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and depth < MAXIMUM_DEPTH:
        if value and value.keys() <= {"sec", "nsec", "nanosec", "secs", "nsecs"}:
            yield path, TIME
            return
        for name, inside in value.items():
            yield from _of_json(inside, f"{path}.{name}" if path else name, depth + 1)
    elif isinstance(value, list):
        if all(isinstance(element, int | float | None) for element in value):
            yield path, "number[]"
        elif all(isinstance(element, str) for element in value):
            yield path, f"{TEXT}[]"
        else:
            yield from _of_json(value[0], f"{path}[0]", depth + 1)
    elif isinstance(value, int | float | None):
        yield path, "number"
    elif isinstance(value, str):
        yield path, TEXT


def _of_protobuf(descriptor: Any, prefix: str, depth: int) -> Iterator[tuple[str, str]]:
    for entry in descriptor.fields if depth < MAXIMUM_DEPTH else ():
        path, is_list = f"{prefix}{entry.name}", entry.is_repeated
        if entry.message_type is not None and entry.message_type.GetOptions().map_entry:
            yield path, MAP
        elif entry.message_type is None:
            kind = TEXT if entry.cpp_type == entry.CPPTYPE_STRING else "number"
            yield path, kind + ("[]" if is_list else "")
        elif entry.message_type.full_name in PROTOBUF_TIMES:
            yield path, TIME
        else:
            inside = f"{path}[0]." if is_list else f"{path}."
            yield from _of_protobuf(entry.message_type, inside, depth + 1)
