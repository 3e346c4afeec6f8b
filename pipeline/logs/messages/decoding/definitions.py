"""Message definitions: from the text in a bag to the fields of a type.

`rosbags` parses the text; nothing is executed. Bags without definitions (ROS 2 sqlite3 before Iron) are read with the
standard definitions of the ROS 2 release that `rosbags` calls its latest.
"""

import enum
import functools
from dataclasses import dataclass

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from pipeline.logs.messages.decoding.idl_text import simplified_idl

MAXIMUM_FIELDS = 10_000  # of a type with empty sequences; nested definitions can grow exponentially
MAXIMUM_DEFINITION_CHARACTERS = 1 << 18  # the largest of ROS's own has some 20 thousand
DEFINITION_FORMATS = ("ros1msg", "ros2msg", "ros2idl", "")
IDL_SEPARATOR = "=" * 80 + "\n"


class DefinitionError(Exception):
    """A definition that cannot be parsed, or an undefined type."""


class Repetition(enum.Enum):
    """How often a field's type occurs in the message."""

    once = "once"
    array = "array"  # a fixed number of times, without a length word
    sequence = "sequence"  # as often as its length word states


@dataclass(frozen=True)
class Field:
    """A field of a message type.

    Attributes:
        name: Field name.
        type_name: A primitive (`float64`, `string`) or another message type.
        is_primitive: Whether the type is primitive.
        repetition: Scalar, array or sequence.
        length: Number of elements of an array.
    """

    name: str
    type_name: str
    is_primitive: bool
    repetition: Repetition
    length: int = 1


Definitions = dict[str, tuple[Field, ...]]


def full_type_name(name: str) -> str:
    """Write `sensor_msgs/JointState` (ROS 1) as `sensor_msgs/msg/JointState`."""
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"


@functools.lru_cache(maxsize=64)
def parse_definition(type_name: str, definition: str, definition_format: str) -> Definitions:
    """Return the fields of a type and of every nested type.

    Args:
        type_name: Full type name.
        definition: Text of the definition; empty: the standard definition of that name.
        definition_format: `ros1msg`, `ros2msg` or `ros2idl`.

    Raises:
        DefinitionError: The text cannot be parsed, or the name has no standard definition.
    """
    if not definition:
        return standard_definitions(definition_format, type_name)
    if len(definition) > MAXIMUM_DEFINITION_CHARACTERS:
        raise DefinitionError(f"definition of {type_name} has {len(definition)} characters")
    if definition_format not in DEFINITION_FORMATS:
        raise DefinitionError(
            f"definition of {type_name} is written in `{definition_format}`, which is not read"
        )
    lines = definition.replace("\r\n", "\n")
    try:
        parsed = (
            _types_of_idl(lines) if definition_format == "ros2idl" else get_types_from_msg(lines, type_name)
        )
    except Exception as error:  # the parser may raise anything on foreign text
        reason = str(error).partition("\n")[0] if isinstance(error, ValueError) else type(error).__name__
        raise DefinitionError(f"definition of {type_name} cannot be parsed ({reason})") from error
    return _complete(type_name, parsed)


def _types_of_idl(definition: str) -> dict:
    """Parse the files of a definition in IDL, each after a separator and its type's name."""
    parsed: dict = {}
    for part in definition.split(IDL_SEPARATOR):
        text = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if prepared := simplified_idl(text):
            parsed.update(get_types_from_idl(prepared))
    return parsed


def standard_definitions(definition_format: str, type_name: str) -> Definitions:
    """Return the standard definitions of ROS (ROS 1 Noetic, or the latest ROS 2).

    Raises:
        DefinitionError: ROS lacks a type of that name.
    """
    ros1 = definition_format == "ros1msg"
    standard = _standard_store(ros1)
    if type_name not in standard:
        raise DefinitionError(
            f"the bag carries no definition of {type_name}, nor does ROS {1 if ros1 else 2}"
        )
    return standard


@functools.lru_cache(maxsize=2)
def _standard_store(ros1: bool) -> Definitions:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    return {name: tuple(_field(*entry) for entry in fields) for name, (_, fields) in store.fielddefs.items()}


def _complete(type_name: str, parsed: dict) -> Definitions:
    """Add ROS's built-in types (time stamps) and check that all types are defined."""
    definitions = {name: tuple(_field(*entry) for entry in fields) for name, (_, fields) in parsed.items()}
    for name in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        definitions.setdefault(name, _standard_store(False)[name])
    if type_name not in definitions:
        raise DefinitionError(f"definition of {type_name} does not define it")
    for fields in definitions.values():
        for field in fields:
            if not field.is_primitive and field.type_name not in definitions:
                raise DefinitionError(f"definition of {type_name} lacks {field.type_name}")
    if _n_fields(type_name, definitions, {}) > MAXIMUM_FIELDS:
        raise DefinitionError(f"definition of {type_name} holds itself or more than {MAXIMUM_FIELDS} fields")
    return definitions


def _n_fields(type_name: str, definitions: Definitions, known: dict[str, int]) -> int:
    """Count the fields of a type, those of nested types included."""
    if type_name not in known:
        known[type_name] = MAXIMUM_FIELDS + 1  # the count of a recursive type
        total = 0
        for field in definitions[type_name]:
            inside = 0
            if not field.is_primitive and field.repetition is not Repetition.sequence:
                inside = _n_fields(field.type_name, definitions, known)
            total += 1 + (0 if field.repetition is Repetition.sequence else field.length) * inside
        known[type_name] = total
    return known[type_name]


def _field(name: str, descriptor: tuple) -> Field:
    kind, content = descriptor
    repetition, length = Repetition.once, 1
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        repetition = Repetition.array if kind == Nodetype.ARRAY else Repetition.sequence
        (kind, content), length = content
    primitive = kind == Nodetype.BASE
    return Field(name, content[0] if primitive else content, primitive, repetition, length)
