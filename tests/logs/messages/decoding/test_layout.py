"""Block decoding against `rosbags`' deserialisers, message by message and bit by bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pipeline.logs.messages.decoding.definitions import DefinitionError, parse_definition
from pipeline.logs.messages.decoding.layout import LayoutError, decode_block, layout_of
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock
from tests.logs.samples.foreign_bags import ROS1, ROS2, joint_state

PROBE = """# alignment of every kind
bool flag
float64 value
string[] words
uint8[3] colour
sequence_free/Pair[2] pairs
sequence_free/Pair[] more
int16[] small
float32[] thin
float64[] wide
string last
int64 end
================================================================================
MSG: sequence_free/Pair
uint8 a
float64 b
string c
"""
PROBE_TYPE = "probe/msg/Probe"
PATHS = (
    "flag",
    "value",
    "words",
    "colour",
    "pairs[0].b",
    "pairs[1].c",
    "more[0].a",
    "small",
    "thin",
    "wide",
    "end",
)


def probe_store(base):
    store = get_typestore(base)
    store.register(get_types_from_msg(PROBE, PROBE_TYPE))
    return store


STORES = {"ros1": probe_store(Stores.ROS1_NOETIC), "cdr": probe_store(Stores.ROS2_HUMBLE)}
short_text = st.text("abcé", max_size=6)
finite = st.floats(allow_nan=False)
narrow = st.floats(allow_nan=False, width=32)


@st.composite
def probes(draw, store):
    pair = store.types["sequence_free/msg/Pair"]
    pairs = st.builds(pair, a=st.integers(0, 255), b=finite, c=short_text)
    return store.types[PROBE_TYPE](
        flag=draw(st.booleans()),
        value=draw(finite),
        words=draw(st.lists(short_text, max_size=3)),
        colour=np.array(draw(st.lists(st.integers(0, 255), min_size=3, max_size=3)), np.uint8),
        pairs=draw(st.lists(pairs, min_size=2, max_size=2)),
        more=draw(st.lists(pairs, max_size=2)),
        small=np.array(draw(st.lists(st.integers(-9, 9), max_size=3)), np.int16),
        thin=np.array(draw(st.lists(narrow, max_size=2)), np.float32),
        wide=np.array(draw(st.lists(finite, max_size=2)), np.float64),
        last=draw(short_text),
        end=draw(st.integers(-(2**63), 2**63 - 1)),
    )


def block_of(messages: list[bytes], topic: LoggedTopic) -> MessageBlock:
    length = np.array([len(message) for message in messages], np.int64)
    data = np.frombuffer(b"".join(messages), np.uint8)
    return MessageBlock(topic, np.arange(len(messages)), data, np.cumsum(length) - length, length)


def look_up(message, path):
    for part in path.replace("[", ".[").split("."):
        message = message[int(part[1:-1])] if part.startswith("[") else getattr(message, part)
    return message


@pytest.mark.parametrize("form", ["ros1", "cdr", "cdr big-endian"])
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_mixture_of_layouts_is_decoded_as_one_by_one(form, data):
    encoding, store = form.split()[0], STORES[form.split()[0]]
    originals = data.draw(st.lists(probes(store), min_size=1, max_size=4))
    originals = [
        originals[i] for i in data.draw(st.lists(st.integers(0, len(originals) - 1), min_size=1, max_size=30))
    ]
    if encoding == "ros1":
        raw = [bytes(store.serialize_ros1(message, PROBE_TYPE)) for message in originals]
        expected = [store.deserialize_ros1(message, PROBE_TYPE) for message in raw]
    else:
        raw = [
            bytes(store.serialize_cdr(message, PROBE_TYPE, little_endian="big" not in form))
            for message in originals
        ]
        expected = [store.deserialize_cdr(message, PROBE_TYPE) for message in raw]
    topic = LoggedTopic("/probe", PROBE_TYPE, encoding, PROBE, "ros2msg")
    definitions = parse_definition(PROBE_TYPE, PROBE, "ros2msg")
    groups, malformed = decode_block(block_of(raw, topic), definitions, PATHS)
    assert len(malformed) == 0
    assert sorted(np.concatenate([group.index for group in groups])) == list(range(len(raw)))
    for group in groups:
        for row, number in enumerate(group.index):
            for path in PATHS:
                if path == "more[0].a" and not expected[number].more:
                    assert path not in group.numbers
                    continue
                value = look_up(expected[number], path)
                if path == "words":
                    assert group.strings[path] == tuple(value)
                elif path.endswith(".c"):
                    assert group.strings[path] == (value,)
                else:
                    mine = group.numbers[path][row]
                    theirs = np.atleast_1d(np.asarray(value)).astype(mine.dtype.newbyteorder("="))
                    assert mine.astype(mine.dtype.newbyteorder("=")).tobytes() == theirs.tobytes()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=40))
def test_more_layouts_than_are_shared(shapes):
    """Past the shared layouts each message is walked by itself; the result is the same."""
    raw, expected = [], []
    for number, (n_names, with_velocity) in enumerate(shapes):
        position = np.arange(n_names) + number
        message = joint_state(
            ROS2, number, [f"j{i}" for i in range(n_names)], position, position * with_velocity
        )
        raw.append(bytes(ROS2.serialize_cdr(message, message.__msgtype__)))
        expected.append(position)
    topic = LoggedTopic("/j", "sensor_msgs/msg/JointState", "cdr", "", "ros2msg")
    definitions = parse_definition(topic.type_name, "", "ros2msg")
    groups, _ = decode_block(block_of(raw, topic), definitions, ("name", "position"))
    got = {int(i): group.numbers["position"][row] for group in groups for row, i in enumerate(group.index)}
    for number, position in enumerate(expected):
        np.testing.assert_array_equal(got[number], position)


def test_names_decide_the_group():
    """Two messages alike but for the order of their names must not share a group."""
    raw = [
        bytes(ROS1.serialize_ros1(joint_state(ROS1, 1, names, [1.0, 2.0]), "sensor_msgs/msg/JointState"))
        for names in (["aa", "bb"], ["bb", "aa"])
    ]
    topic = LoggedTopic("/j", "sensor_msgs/msg/JointState", "ros1", "", "ros1msg")
    groups, _ = decode_block(
        block_of(raw, topic), parse_definition(topic.type_name, "", "ros1msg"), ("name",)
    )
    assert [group.strings["name"] for group in groups] == [("aa", "bb"), ("bb", "aa")]


@given(st.binary(max_size=200))
def test_arbitrary_bytes_never_do_worse_than_a_layout_error(message):
    definitions = parse_definition(PROBE_TYPE, PROBE, "ros2msg")
    for encoding in ("ros1", "cdr"):
        try:
            layout = layout_of(message, definitions, PROBE_TYPE, encoding, PATHS)
        except LayoutError:
            continue
        for span in layout.numbers.values():
            assert span.offset >= 0 and span.offset + np.dtype(span.dtype).itemsize * span.count <= len(
                message
            )


def test_definitions_that_multiply_without_bytes_end():
    text = (
        "L1 a\nL1 b\n"
        + "".join(f"{'=' * 80}\nMSG: p/L{i}\nL{i + 1} a\nL{i + 1} b\n" for i in range(1, 30))
        + f"{'=' * 80}\nMSG: p/L30\n"
    )
    with pytest.raises(DefinitionError, match="more than"):
        parse_definition("p/msg/T", text, "ros1msg")
    with pytest.raises(DefinitionError, match="holds itself"):
        parse_definition("p/msg/T", "T again\n", "ros1msg")


@pytest.mark.parametrize("text", ["float64", "Missing x\n", "\x00", "float64 x\n" * 200_000])
def test_damaged_definitions(text):
    with pytest.raises(DefinitionError):
        parse_definition("p/msg/T", text, "ros2msg")


def test_unknown_type_without_definition():
    with pytest.raises(DefinitionError, match="carries no definition of p/msg/T"):
        parse_definition("p/msg/T", "", "ros2msg")
