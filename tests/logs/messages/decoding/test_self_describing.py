"""Messages in JSON and Protobuf give what the same session gives in CDR."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet

from pipeline.logs.describe.field_types import field_types
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.adapters import NamedColumn
from pipeline.logs.messages.channel_sources import channel_adapter
from pipeline.logs.messages.columns import MemoryStore
from pipeline.logs.messages.decoding.definitions import DefinitionError
from pipeline.logs.messages.decoding.encodings import decode
from pipeline.logs.messages.decoding.field_paths import (
    EVERY,
    NO_TIME,
    number_at,
    stamp_paths,
    stamps_ns,
    steps_of,
)
from pipeline.logs.messages.decoding.protobuf_messages import message_class_of
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock, ReadingLedger
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.topic_columns import TopicColumns
from pipeline.logs.trajectories import load_trajectories
from pipeline.machine.log_sources import ChannelSource, CommandSource, CommandSourceKind, JointStateSource
from tests.logs.conftest import make_session
from tests.logs.samples import self_describing_bags as bags


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=6)


@pytest.fixture(scope="module")
def by_path(machine):
    """Commands by field path; joint states are Foxglove's own, by the joints' names."""
    paths = [f"data[{number}]" for number in range(machine.n_joint)]
    return replace(machine, commands=CommandSource(source=CommandSourceKind.field_path, field_paths=paths))


def block_of(encoding, *messages, type_name="", definition=""):
    length = np.array([len(message) for message in messages])
    data = np.frombuffer(b"".join(messages), np.uint8)
    topic = LoggedTopic("/t", type_name, encoding, definition)
    return MessageBlock(topic, np.arange(len(messages)), data, np.cumsum(length) - length, length)


@pytest.mark.parametrize("kind", bags.KINDS)
def test_exactly_the_samples_of_the_session(tmp_path, by_path, short, kind):
    flipped = replace(short, q=short.q[:, ::-1])
    bags.write(tmp_path / "b.mcap", kind, flipped, by_path.joint_names[::-1])
    entry = find_logs(tmp_path / "b.mcap")[0]
    raw = read_log(entry, by_path)
    np.testing.assert_array_equal(raw.q, short.q)
    np.testing.assert_array_equal(raw.joint_stamp_ns, short.stamp_ns)
    np.testing.assert_array_equal(raw.joint_log_time_ns, short.log_time_ns)
    np.testing.assert_array_equal(raw.command, short.command)
    assert not raw.notes


@pytest.mark.parametrize("kind", bags.KINDS)
def test_exactly_the_tuples_of_cdr(tmp_path, machine, by_path, short, config, loop_tracker, kind):
    short.write(tmp_path / "cdr" / "a", machine)
    (tmp_path / kind).mkdir()
    bags.write(tmp_path / kind / "a.mcap", kind, short, machine.joint_names)
    paths = replace(
        by_path,
        joint_states=JointStateSource(
            field_paths=[f"joints[{i}].position" for i in range(4)], stamp="timestamp"
        ),
    )
    (expected,) = load_trajectories(tmp_path / "cdr", machine, config, loop_tracker)
    for described in (by_path, paths):
        (found,) = load_trajectories(tmp_path / kind, described, config, loop_tracker)
        for name in ("stamp_ns", "q", "qd", "a", "t_s"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("sec", ['"2026-11-28T04:57:19Z"', "null", "NaN", "1e300", "-1e12", "Infinity"])
def test_time_stamps_that_are_no_times_cost_their_messages(sec):
    stamp = b'{"timestamp": {"sec": %s, "nanosec": 5}, "x": %d}'
    messages = [stamp % (b"7", 1), stamp % (sec.encode(), 2), stamp % (b"4000000000", 3)]
    source, store, ledger = (
        ChannelSource("x", "/t", "x", clock="header_stamp"),
        MemoryStore(),
        ReadingLedger(Path("a")),
    )
    collector = TopicColumns("/t", channel_adapter(source), store)
    collector.add(block_of("json", *messages))
    columns = collector.finish(ledger)
    np.testing.assert_array_equal(columns["value"], [1, 3])
    np.testing.assert_array_equal(columns["stamp_ns"], [7_000_000_005, 4_000_000_000_000_000_005])
    (note,) = ledger.notes
    reason = "they have no time stamp" if sec.startswith('"') else "their time stamp is not a time"
    assert note.text.startswith(f"1 message of /t (channel x) left out: {reason}")


def test_messages_of_several_shapes_keep_their_order():
    block = block_of(
        "json", b'{"x": 1, "d": [1, 2]}', b"{", b'{"x": 2.5, "d": [3]}', b'{"x": null, "d": [4, 5]}'
    )
    groups, malformed = decode(block, ("x", "d[1]"))
    assert malformed.tolist() == [1]
    two, one = groups
    assert two.index.tolist() == [0, 3] and one.index.tolist() == [2]
    np.testing.assert_array_equal(number_at(two, "x"), [1, np.nan])
    np.testing.assert_array_equal(number_at(two, "d[1]"), [2, 5])
    with pytest.raises(MismatchError, match="holds 1 values"):
        number_at(one, "d[1]")


@pytest.mark.parametrize(
    "text",
    [b"[" * 100_000, b"9" * 10_000, b'{"x": [[1]]}', b'{"x": {"y": 1}}', b'"x"', b"null", b"\xff", b""],
)
def test_odd_json_has_no_such_field(text):
    groups, malformed = decode(block_of("json", text), ("x", "x[3]", "x[].y"))
    assert all(not group.numbers for group in groups) and len(groups) + len(malformed) == 1


def test_numbers_beyond_64_bits_are_floats():
    ((group,), _) = decode(
        block_of("json", b'{"x": 18446744073709551616, "y": -1%s}' % (b"0" * 400)), ("x", "y")
    )
    assert group.number("x")[0] == 2.0**64 and group.number("y")[0] == -np.inf


def test_stamps_of_every_convention():
    for names in (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs")):
        message = b'{"s": {"%s": 5, "%s": 7}}' % tuple(name.encode() for name in names)
        ((group,), _) = decode(block_of("json", message), (f"s.{names[0]}", f"s.{names[1]}"))
        assert stamps_ns(group, "s").tolist() == [5_000_000_007]


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("2024-05-06T07:08:09Z", 1_714_979_289_000_000_000),
        ("2024-05-06T09:08:09.000000001+02:00", 1_714_979_289_000_000_001),
        ("1969-12-31 23:59:59.5", -500_000_000),
        ("07:08:09", NO_TIME),
        ("2024-13-06T07:08:09Z", NO_TIME),
    ],
)
def test_times_in_text_are_those_of_rfc_3339(text, stamp):
    """As Protobuf writes time stamps in JSON; other texts give neither a time nor zero."""
    ((group,), _) = decode(block_of("json", b'{"timestamp": "%s"}' % text.encode()), stamp_paths())
    assert stamps_ns(group).tolist() == [stamp]


def test_seconds_may_have_a_fraction():
    for seconds, stamp in (("1.25", 1_250_000_007), ("-0.5", -499_999_993), ("1e300", NO_TIME)):
        ((group,), _) = decode(
            block_of("json", b'{"s": {"sec": %s, "nsec": 7}}' % seconds.encode()), ("s.sec", "s.nsec")
        )
        assert stamps_ns(group, "s").tolist() == [stamp]


def test_steps_of_paths():
    assert steps_of("a.b[3].c[].d") == ("a", "b", 3, "c", EVERY, "d")


def test_unset_numbers_of_protobuf():
    """An optional position that is not set gives none; a number without presence is zero."""
    states, _ = bags.classes()
    definition = bags.schema_files().SerializeToString().decode("latin-1")
    message = states(joints=[{"name": "a"}, {"name": "b", "position": 2.0}]).SerializeToString()
    block = block_of("protobuf", message, type_name="foxglove.JointStates", definition=definition)
    ((group,), _) = decode(block, ("joints[].position", "joints[].name", "timestamp.seconds"))
    np.testing.assert_array_equal(group.sequence("joints[].position"), [[np.nan, 2.0]])
    assert group.text("joints[].name") == ("a", "b") and group.number("timestamp.seconds")[0] == 0


@pytest.mark.parametrize(
    "files",
    [
        b"\xff\xff",
        b"",
        FileDescriptorSet(file=[FileDescriptorProto(name="a", dependency=["a", "b"])]).SerializeToString(),
        FileDescriptorSet(
            file=[
                FileDescriptorProto(name="a", dependency=["b"]),
                FileDescriptorProto(name="b", dependency=["a"]),
            ]
        ).SerializeToString(),
        bytes(1 << 20),
    ],
)
def test_schemas_that_cannot_be_used(files):
    block = block_of("protobuf", b"", type_name="a.B", definition=files.decode("latin-1"))
    with pytest.raises(DefinitionError, match=r"definition of a\.B"):
        decode(block, ("x",))


def test_encoding_that_is_not_read():
    with pytest.raises(MismatchError, match=r"their encoding `cbor` is not one of cdr, ros1, json, protobuf"):
        decode(block_of("cbor", b""), ("x",))


def protobuf_of(fields, nested=()):
    """A class `a.B` with these fields, its definition, and messages nested in it."""
    file = FileDescriptorProto(name="a.proto", package="a", syntax="proto3")
    message = file.message_type.add(name="B")
    for number, field in enumerate(fields, 1):
        bags.add_field(message, number, *field)
    message.nested_type.extend(nested)
    files = FileDescriptorSet(file=[file])
    definition = files.SerializeToString().decode("latin-1")
    return message_class_of(LoggedTopic("/t", "a.B", "protobuf", definition)), definition


def test_a_map_of_protobuf():
    entry = DescriptorProto(name="VoltsEntry")
    entry.options.map_entry = True
    bags.add_field(entry, 1, "key", bags.STRING)
    bags.add_field(entry, 2, "value", bags.DOUBLE)
    kind, definition = protobuf_of([("volts", bags.MESSAGE, ".a.B.VoltsEntry", True)], [entry])
    message = kind(volts={"left": 2.0, "right": 3.0}).SerializeToString()
    block = block_of("protobuf", message, type_name="a.B", definition=definition)
    assert field_types(block.topic, message) == {"volts": "map"}
    ((group,), _) = decode(block, ("volts.left", "volts[0]", "volts[0].value", "volts", "volts.left[0]"))
    assert list(group.numbers) == ["volts.left"] and group.number("volts.left")[0] == 2.0


def test_fields_of_one_choice():
    """Fields that are not wanted are not decoded; one that is not set is not a number."""
    kind, definition = protobuf_of([(name, bags.DOUBLE, "", False, True) for name in ("x", "y", "z")])
    message = kind(x=1.0, z=3.0).SerializeToString()
    block = block_of("protobuf", message, type_name="a.B", definition=definition)
    ((group,), _) = decode(block, ("y", "z"))
    assert np.isnan(group.number("y")[0]) and group.number("z")[0] == 3.0


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_millions_of_empty_elements_are_refused_unparsed(encoding):
    definition = bags.schema_files().SerializeToString().decode("latin-1")
    empty = b'{"joints": [%s{}]}' % (b"{}," * 2_000_000) if encoding == "json" else b"\x12\x00" * 3_000_000
    good = bags.joint_states(encoding, 0, ["a"], [1.0])
    block = block_of(encoding, empty, good, type_name="foxglove.JointStates", definition=definition)
    begin = time.process_time()
    ((group,), malformed) = decode(block, ("joints[].position", "joints[].name", "joints[1].name"))
    assert time.process_time() - begin < 1.0
    assert malformed.tolist() == [0] and group.index.tolist() == [1]
    almost = empty[: len(empty) // 4] if encoding == "protobuf" else b'{"joints": [%s{}]}' % (b"{}," * 10**6)
    assert decode(
        block_of(encoding, almost, type_name="foxglove.JointStates", definition=definition),
        ("joints[].name",),
    )
    assert time.process_time() - begin < 2.0


def test_only_wanted_fields_are_laid_out():
    """Elements that hold nothing take memory for each field of their class: 16 KB with 2,000 of them."""
    inner = DescriptorProto(name="C")
    for number in range(1, 2001):
        bags.add_field(inner, number, f"x{number}", bags.DOUBLE)
    kind, definition = protobuf_of([("c", bags.MESSAGE, ".a.B.C", True)], [inner])
    block = block_of("protobuf", b"", type_name="a.B", definition=definition)
    small = message_class_of(block.topic, frozenset({"c", "x7"}))
    assert [list(one.DESCRIPTOR.nested_types[0].fields_by_name) for one in (kind, small)][1] == ["x7"]
    assert small.FromString(kind(c=[{"x6": 6.0, "x7": 7.0}]).SerializeToString()).c[0].x7 == 7.0


@pytest.mark.parametrize("encoding", bags.KINDS)
@pytest.mark.parametrize(("names", "values"), [("joints[].name", "joints[].position"), ("name[]", "value[]")])
def test_commands_by_name(encoding, names, values):
    source = NamedColumn("commands", "command", ("a", "b"), lambda _: (names, values))
    if names == "name[]":
        kind, definition = protobuf_of([("name", bags.STRING, "", True), ("value", bags.DOUBLE, "", True)])
        one = (
            json.dumps({"name": ["b", "a"], "value": [2.0, 1.0]}).encode()
            if encoding == "json"
            else kind(name=["b", "a"], value=[2.0, 1.0]).SerializeToString()
        )
        block = block_of(encoding, one, type_name="a.B", definition=definition)
    else:
        definition = bags.schema_files().SerializeToString().decode("latin-1")
        one = bags.joint_states(encoding, 0, ["b", "c", "a"], [2.0, 3.0, 1.0])
        block = block_of(encoding, one, type_name="foxglove.JointStates", definition=definition)
    ((group,), malformed) = decode(block, source.wanted(block.topic))
    assert source.convert(group)["command"].tolist() == [[1.0, 2.0]] and not len(malformed)
