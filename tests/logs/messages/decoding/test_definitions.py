"""Message definitions in IDL (`ros2idl`), in files that the `mcap` library wrote, against `rosbags`' deserialisers."""

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.mcap.file import read_mcap
from pipeline.logs.messages.decoding.definitions import (
    DefinitionError,
    parse_definition,
    standard_definitions,
)
from pipeline.logs.messages.decoding.layout import decode_block
from pipeline.logs.messages.message_blocks import ReadingLedger
from tests.logs.conftest import make_session
from tests.logs.formats.test_formats import assert_holds
from tests.logs.samples import foreign_bags as foreign

# As `rosidl_adapter` writes them from the .msg files.
TIME = """// generated from rosidl_adapter/resource/msg.idl.em
// with input from builtin_interfaces/msg/Time.msg
// generated code does not contain a copyright notice


module builtin_interfaces {
  module msg {
    @verbatim (language="comment", text=
      "This message communicates ROS Time defined here:" "\\n"
      "https://design.ros2.org/articles/clock_and_time.html")
    struct Time {
      @verbatim (language="comment", text=
        "The seconds component, valid over all int32 values.")
      int32 sec;

      uint32 nanosec;
    };
  };
};
"""
HEADER = """#include "builtin_interfaces/msg/Time.idl"

module std_msgs {
  module msg {
    /* Standard metadata for higher-level stamped data types. */
    struct Header {
      builtin_interfaces::msg::Time stamp;

      string frame_id;
    };
  };
};
"""
JOINT_STATE = """#include "std_msgs/msg/Header.idl"

module sensor_msgs {
  module msg {
    @verbatim (language="comment", text=
      "The state of each joint (revolute or prismatic) is defined by:" "\\n"
      " * the position of the joint (rad or m)," "\\n"
      " * \\"effort\\" (Nm or N).")
    struct JointState {
      std_msgs::msg::Header header;

      sequence<string> name;

      @unit (value="rad")
      sequence<double> position;

      sequence<double> velocity;

      sequence<double> effort;
    };
  };
};
"""
DIMENSION = """module std_msgs { module msg { struct MultiArrayDimension {
  string label; uint32 size; uint32 stride; }; }; };
"""
LAYOUT = """#include "std_msgs/msg/MultiArrayDimension.idl"
module std_msgs { module msg { struct MultiArrayLayout {
  sequence<std_msgs::msg::MultiArrayDimension> dim; uint32 data_offset; }; }; };
"""
ARRAY = """#include "std_msgs/msg/MultiArrayLayout.idl"
module std_msgs { module msg { struct Int8MultiArray {
  std_msgs::msg::MultiArrayLayout layout; sequence<int8> data; }; }; };
"""
VALVES = """#include "valve_msgs/msg/Spool.idl"

module valve_msgs {
  module msg {
    typedef float float__3[3];
    typedef valve_msgs::msg::Spool valve_msgs__msg__Spool[2];
    module Valves_Constants {
      const uint8 OPEN = 1;
      const int32 CLOSED = -1;
      @verbatim (language="comment", text="a (b")
      const string NAME = "x; }";
    };
    struct Valves {
      boolean enabled;

      octet flags;

      @default (value=-0.5)
      double pressure;

      float__3 current;

      valve_msgs__msg__Spool spools;

      sequence<int16, 8> small;

      string<12> label;

      int64 counter;

      uint8 level;
    };
  };
};
"""
SPOOL = """module valve_msgs { module msg { struct Spool { uint8 side; double travel; }; }; };
"""
# The same, by hand in the other language.
VALVES_MSG = """bool enabled
byte flags
float64 pressure
float32[3] current
valve_msgs/Spool[2] spools
int16[<=8] small
string<=12 label
int64 counter
uint8 level
================================================================================
MSG: valve_msgs/Spool
uint8 side
float64 travel
"""
VALVES_TYPE = "valve_msgs/msg/Valves"
PATHS = (
    "enabled",
    "flags",
    "pressure",
    "current",
    "spools[0].travel",
    "spools[1].side",
    "small",
    "counter",
    "level",
)
FILES = {
    "sensor_msgs/msg/JointState": JOINT_STATE,
    "std_msgs/msg/Header": HEADER,
    "builtin_interfaces/msg/Time": TIME,
    "std_msgs/msg/Int8MultiArray": ARRAY,
    "std_msgs/msg/MultiArrayLayout": LAYOUT,
    "std_msgs/msg/MultiArrayDimension": DIMENSION,
    VALVES_TYPE: VALVES,
    "valve_msgs/msg/Spool": SPOOL,
}
DEPENDENCIES = {
    "sensor_msgs/msg/JointState": ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"),
    "std_msgs/msg/Int8MultiArray": ("std_msgs/msg/MultiArrayLayout", "std_msgs/msg/MultiArrayDimension"),
    VALVES_TYPE: ("valve_msgs/msg/Spool",),
}


def idl(type_name: str, first_is_named: bool = True, end: str = "\n") -> str:
    """A definition as rosbag2 (each file named) or as others (the first one not) put it together."""
    parts = []
    for name in (type_name, *DEPENDENCIES[type_name]):
        named = first_is_named or name != type_name
        parts.append((f"{'=' * 80}\nIDL: {name}\n" if named else "") + FILES[name])
    return "\n".join(parts).replace("\n", end)


def write(path, entries, store, definition_of, definition_format="ros2idl"):
    """Without compression and checksums, so that the fuzzer reaches the definitions."""
    with path.open("wb") as stream:
        writer = Writer(stream, 1 << 14, CompressionType.NONE, enable_crcs=False)
        writer.start(profile="ros2", library="test")
        channels = {}
        for time_ns, topic, message in entries:
            if topic not in channels:
                kind = message.__msgtype__
                schema = writer.register_schema(kind, definition_format, definition_of(kind).encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, message.__msgtype__))
            writer.add_message(channels[topic], time_ns, data, publish_time=time_ns)
        writer.finish()
    return path


@pytest.mark.parametrize("first_is_named", [True, False])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_joint_states_and_commands(tmp_path, machine, first_is_named, end):
    session = make_session(machine, seconds=5)
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    write(tmp_path / "a.mcap", entries, foreign.ROS2, lambda kind: idl(kind, first_is_named, end))
    (entry,) = find_logs(tmp_path)
    assert_holds(read_log(entry, machine), session)


def test_custom_message(tmp_path):
    """Decoded values against what was serialised, with the layout that `rosbags` takes from the other language."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(VALVES_MSG, VALVES_TYPE))
    rng = np.random.default_rng(0)
    spool = store.types["valve_msgs/msg/Spool"]
    messages = [
        store.types[VALVES_TYPE](
            enabled=bool(rng.integers(2)),
            flags=int(rng.integers(128)),
            pressure=rng.normal(),
            current=rng.normal(size=3).astype(np.float32),
            spools=[spool(side=int(rng.integers(256)), travel=rng.normal()) for _ in range(2)],
            small=rng.integers(-99, 99, rng.integers(0, 5)).astype(np.int16),
            label="x" * int(rng.integers(0, 9)),
            counter=int(rng.integers(-(1 << 60), 1 << 60)),
            level=int(rng.integers(256)),
        )
        for _ in range(50)
    ]
    entries = [(number, "/valves", message) for number, message in enumerate(messages)]
    path = write(tmp_path / "a.mcap", entries, store, idl)
    (block,) = read_mcap(path, ReadingLedger(path), {"/valves"})
    definitions = parse_definition(block.topic.type_name, block.topic.definition, "ros2idl")
    groups, malformed = decode_block(block, definitions, PATHS)
    assert not len(malformed) and sum(len(group.index) for group in groups) == 50
    for group in groups:
        for row, index in enumerate(group.index):
            message = messages[index]
            assert group.number("pressure")[row] == message.pressure
            assert group.number("enabled")[row] == message.enabled
            assert group.number("flags")[row] == message.flags
            assert group.number("counter")[row] == message.counter
            assert group.number("level")[row] == message.level
            assert group.number("spools[0].travel")[row] == message.spools[0].travel
            assert group.number("spools[1].side")[row] == message.spools[1].side
            np.testing.assert_array_equal(group.sequence("current")[row], message.current)
            np.testing.assert_array_equal(group.sequence("small")[row], message.small)


def test_idl_and_msg_define_the_same():
    standard = standard_definitions("ros2msg", "sensor_msgs/msg/JointState")
    for name, fields in parse_definition(
        "sensor_msgs/msg/JointState", idl("sensor_msgs/msg/JointState"), "ros2idl"
    ).items():
        assert fields == standard[name]
    assert (
        parse_definition(VALVES_TYPE, idl(VALVES_TYPE), "ros2idl")[VALVES_TYPE]
        == parse_definition(VALVES_TYPE, VALVES_MSG, "ros2msg")[VALVES_TYPE]
    )


STRUCT = "module a { module msg { struct X { double x; }; %s }; };"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (STRUCT % "const long A = ((((((((1))))))));", "expressions in parentheses"),
        (STRUCT % "const long A = 1 << 99999999999999;", "nested|not read|cannot be parsed"),
        (STRUCT % ("typedef " + "sequence<" * 30 + "double" + ",2>" * 30 + " b;"), "nested more deeply"),
        ("module a { " * 30 + "};" * 30, "nested more deeply"),
        (STRUCT % "@verbatim (text=(((", "has no end"),
        (STRUCT % "const string A = \"no end;", "is not read"),
        (STRUCT % ("const long A = " + "9" * 5000 + ";"), "too long"),
        ("", "nor does ROS 2"),
        ("module b { struct Y { double x; }; };", "does not define it"),
        ("module a { module msg { struct X { a::msg::Other x; }; }; };", "lacks a/msg/Other"),
        ("module a { module msg { typedef b c; typedef c b; struct X { b x; }; }; };", "cannot be parsed"),
    ],
)  # fmt: skip
def test_definitions_that_are_refused_at_once(text, reason):
    with pytest.raises(DefinitionError, match=reason) as error:
        parse_definition("a/msg/X", text, "ros2idl")
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_other_languages_are_named(tmp_path, machine):
    entries = foreign.messages(foreign.ROS2, make_session(machine, seconds=2), machine.joint_names)
    write(tmp_path / "a.mcap", entries, foreign.ROS2, lambda _: '{"type": "object"}', "jsonschema")
    with pytest.raises(Exception, match="is written in `jsonschema`, which is not read"):
        read_log(find_logs(tmp_path)[0], machine)
