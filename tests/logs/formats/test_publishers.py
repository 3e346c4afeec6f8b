"""Several publishers of one topic, and chunks as writers other than the usual ones make them."""

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Rosbag1Writer

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.compression import bounded_decompression
from pipeline.logs.formats.compression.bounded_decompression import DecompressionError, decompress
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.trajectories import make_trajectories
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import ROS1, whole_log

JOINTS, COMMANDS = "/joint_states", "/joint_commands"


def read(path, machine):
    return read_log(find_logs(path)[0], machine)


def write_rosbag1(path, entries, publisher_of, definition_of=lambda publisher, text: text):
    """A bag with a connection for each publisher of a topic, in chunks of the usual size."""
    with Rosbag1Writer(path) as writer:
        connections = {}
        for number, (time_ns, topic, message) in enumerate(entries):
            key = topic, publisher_of(topic, number)
            if key not in connections:
                text, digest = foreign.ROS1.generate_msgdef(message.__msgtype__)
                connections[key] = writer.add_connection(
                    topic,
                    message.__msgtype__,
                    msgdef=definition_of(key[1], text),
                    md5sum=digest,
                    callerid=f"/node{key[1]}",
                )
            data = foreign.ROS1.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[key], time_ns, data)
    return path


def write_mcap(path, entries, publisher_of):
    """A file with a channel for each publisher of a topic."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 20, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="test")
        channels = {}
        for number, (time_ns, topic, message) in enumerate(entries):
            key = topic, publisher_of(topic, number)
            if key not in channels:
                text, _ = foreign.ROS2.generate_msgdef(message.__msgtype__, ros_version=2)
                schema = writer.register_schema(message.__msgtype__, "ros2msg", text.encode())
                channels[key] = writer.register_channel(topic, "cdr", schema)
            data = bytes(foreign.ROS2.serialize_cdr(message, message.__msgtype__))
            writer.add_message(channels[key], time_ns, data, publish_time=time_ns)
        writer.finish()
    return path


PUBLISHERS = {
    "take turns": lambda topic, number: number % 2,
    "of commands only": lambda topic, number: number % 3 if topic == COMMANDS else 0,
    "restarted": lambda topic, number: number // 300,
}


@pytest.mark.parametrize("name", PUBLISHERS)
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_messages_of_several_publishers_stay_in_order(tmp_path, machine, kind, name):
    session = make_session(machine, seconds=12)
    entries = foreign.messages(foreign.ROS1 if kind == "bag" else foreign.ROS2, session, machine.joint_names)
    write = write_rosbag1 if kind == "bag" else write_mcap
    raw = read(write(tmp_path / f"a.{kind}", entries, PUBLISHERS[name]), machine)
    np.testing.assert_array_equal(raw.joint_log_time_ns, session.log_time_ns)
    np.testing.assert_array_equal(raw.q, session.q)
    np.testing.assert_array_equal(raw.command_log_time_ns, session.command_ns)
    np.testing.assert_array_equal(raw.command, session.command)
    assert not raw.notes


def test_publishers_whose_definitions_differ_in_comments(tmp_path, machine, config, loop_tracker):
    """They are handed on one after the other and put in order by their times."""
    session = make_session(machine, seconds=12)
    entries = foreign.messages(foreign.ROS1, session, machine.joint_names)
    paths = [
        write_rosbag1(tmp_path / "one.bag", entries, lambda *_: 0),
        write_rosbag1(
            tmp_path / "two.bag",
            entries,
            PUBLISHERS["take turns"],
            lambda publisher, text: f"# {publisher}\n{text}",
        ),
    ]
    one, two = (
        make_trajectories(read(path, machine), machine, config, loop_tracker).trajectories for path in paths
    )
    assert len(one) == len(two) == 1
    np.testing.assert_array_equal(one[0].q, two[0].q)
    np.testing.assert_array_equal(one[0].a, two[0].a)


@pytest.mark.parametrize("kind", ROS1)
def test_chunks_of_old_rosbags_declare_one_byte(tmp_path, machine, kind):
    """Its writer put 1 into every chunk's header until August 2023 (ternaris/rosbags#58)."""
    log = whole_log(kind)
    content = bytearray(log.content)
    for chunk in log.chunks:
        at = content.index(b"size=", chunk.start) + 5
        content[at : at + 4] = (1).to_bytes(4, "little")
    raw = read(log.write(tmp_path / "a", bytes(content)), machine)
    assert len(raw.q) + len(raw.command) == log.n_messages and not raw.notes


def in_frames(compression: str, data: bytes, n_frames: int, **options) -> bytes:
    size = -(-len(data) // n_frames)
    parts = [data[begin : begin + size] for begin in range(0, len(data), size)]
    if compression == "zstd":
        return b"".join(zstandard.ZstdCompressor(**options).compress(part) for part in parts)
    return b"".join(lz4.frame.compress(part, **options) for part in parts)


@pytest.mark.parametrize("n_frames", [1, 2, 7])
@pytest.mark.parametrize(
    ("compression", "options"),
    [
        ("zstd", {}),
        ("zstd", {"write_content_size": False}),
        ("lz4", {"block_linked": True, "store_size": True}),
        ("lz4", {"block_linked": False, "store_size": False}),
    ],
)
@pytest.mark.parametrize("padding", [b"", bytes(3)])
def test_chunks_of_several_frames(compression, options, n_frames, padding):
    data = np.random.default_rng(0).integers(0, 9, 100_000).astype(np.uint8).tobytes()
    frames = in_frames(compression, data, n_frames, **options)
    assert decompress(compression, frames + padding, len(data)) == data
    assert decompress(compression, frames, None) == data
    if n_frames > 1:
        with pytest.raises(DecompressionError) as error:
            decompress(compression, frames[:-2], len(data))
        assert data.startswith(error.value.front) and len(error.value.front) >= len(data) // 2 - 1


def test_frames_beyond_the_bound_are_refused(monkeypatch):
    monkeypatch.setattr(bounded_decompression, "MAXIMUM_CHUNK_BYTES", 1000)
    for compression in ("zstd", "lz4"):
        with pytest.raises(DecompressionError):
            decompress(compression, in_frames(compression, bytes(1500), 3), None)


def test_ros1_byte_is_signed(tmp_path, machine):
    """The old name of int8: -1 is no 255."""
    session = make_session(machine, seconds=12)
    entries = foreign.messages(foreign.ROS1, session, machine.joint_names)
    path = write_rosbag1(
        tmp_path / "a.bag", entries, lambda *_: 0, lambda _, text: text.replace("int8[]", "byte[]")
    )
    np.testing.assert_array_equal(read(path, machine).command, session.command)


@pytest.mark.parametrize("kind", range(6, 12))
def test_xcdr2_is_refused_with_the_reason(tmp_path, machine, kind):
    session = make_session(machine, seconds=3)
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        text, _ = foreign.ROS2.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", text.encode())
        channel = writer.register_channel(JOINTS, "cdr", schema)
        for time_ns, topic, message in foreign.messages(foreign.ROS2, session, machine.joint_names):
            if topic == JOINTS:
                data = bytearray(foreign.ROS2.serialize_cdr(message, message.__msgtype__))
                data[1] = kind
                writer.add_message(channel, time_ns, bytes(data), publish_time=time_ns)
        writer.finish()
    with pytest.raises(InputError, match=rf"XCDR2 \(encapsulation {kind:#06x}\), and only XCDR1 is read"):
        read(path, machine)
