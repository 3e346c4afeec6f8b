"""Bags written by other people's tools, message by message, with their own serialisers."""

from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from tests.logs.conftest import Session

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def joint_state(store, stamp_ns: int, names, position, velocity=(), effort=(), frame_id=""):
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9))
    sequence = {"seq": 7} if store is ROS1 else {}
    return types["sensor_msgs/msg/JointState"](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id, **sequence),
        name=list(names),
        position=np.array(position, np.float64),
        velocity=np.array(velocity, np.float64),
        effort=np.array(effort, np.float64),
    )


def array(store, values, kind="Int8"):
    types = store.types
    dtype = {"Int8": np.int8, "Float32": np.float32, "Float64": np.float64, "Int32": np.int32}[kind]
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types[f"std_msgs/msg/{kind}MultiArray"](layout=layout, data=np.array(values, dtype))


def joy(store, stamp_ns: int, axes):
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9))
    sequence = {"seq": 0} if store is ROS1 else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="pad", **sequence)
    return types["sensor_msgs/msg/Joy"](
        header=header, axes=np.array(axes, np.float32), buttons=np.zeros(3, np.int32)
    )


def messages(store, session: Session, names) -> list[tuple[int, str, object]]:
    """The session's messages as (log time, topic, message), in order of log time."""
    states = [
        (int(t), "/joint_states", joint_state(store, s, names, q))
        for t, s, q in zip(session.log_time_ns, session.stamp_ns, session.q, strict=True)
    ]
    commands = [
        (int(t), "/joint_commands", array(store, a))
        for t, a in zip(session.command_ns, session.command, strict=True)
    ]
    return sorted(states + commands, key=lambda entry: entry[0])


def write_rosbag1(path: Path, entries, compression: str = "none", chunk_bytes: int = 1 << 14) -> Path:
    writer = Rosbag1Writer(path)
    if compression != "none":
        writer.set_compression(Rosbag1Writer.CompressionFormat[compression.upper()])
    writer.chunk_threshold = chunk_bytes
    with writer:
        connections = {}
        for time_ns, topic, message in entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ROS1)
            writer.write(connections[topic], time_ns, ROS1.serialize_ros1(message, message.__msgtype__))
    return path


def write_rosbag2(
    path: Path,
    entries,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    version: int = 8,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    writer = Rosbag2Writer(path, version=version, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for time_ns, topic, message in entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ROS2)
            writer.write(connections[topic], time_ns, bytes(ROS2.serialize_cdr(message, message.__msgtype__)))
    return path


def write_mcap(
    path: Path,
    entries,
    compression: str = "zstd",
    chunked: bool = True,
    finish: bool = True,
    enable_crcs: bool = True,
    chunk_bytes: int = 1 << 14,
) -> Path:
    """With the `mcap` library; `finish=False` leaves the file as a crash would: no index, no end."""
    kinds = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=chunk_bytes,
            compression=kinds[compression],
            use_chunking=chunked,
            enable_crcs=enable_crcs,
        )
        writer.start(profile="ros2", library="test")
        channels = {}
        for time_ns, topic, message in entries:
            if topic not in channels:
                definition, _ = ROS2.generate_msgdef(message.__msgtype__, ros_version=2)
                schema = writer.register_schema(message.__msgtype__, "ros2msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(message, message.__msgtype__))
            writer.add_message(channels[topic], time_ns, data, publish_time=time_ns)
        if finish:
            writer.finish()
    return path
