"""Write genuine ROS 2 bags: a folder with an MCAP file and `metadata.yaml`, as `ros2 bag record` does.

Messages of one topic are serialised as arrays: `rosbags` serialises one message, and the numbers of the others are
written into copies of it. The same input gives the same bytes.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.errors import InputError
from pipeline.files.atomic import PARTIAL_SUFFIX
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.conversion import command_conversion, position_conversion
from pipeline.logs.messages.decoding.definitions import parse_definition
from pipeline.logs.messages.decoding.layout import layout_of, structured_view
from pipeline.logs.messages.raw_log import NANOSECONDS, ChannelSamples, TargetPoses
from pipeline.machine.specification import CommandKind, MachineSpecification

METADATA_VERSION = 9
CHUNK_BYTES = 768 * 1024  # rosbag2's default
COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


@dataclass(frozen=True)
class _Channel:
    """One topic and its serialised messages."""

    topic: str
    type_name: str
    log_time_ns: np.ndarray
    messages: list[bytes]


def write_bag(
    path: Path,
    machine: MachineSpecification,
    *,
    joint_state_header_stamp_ns: np.ndarray,
    joint_state_log_time_ns: np.ndarray,
    joint_names: Sequence[str],
    positions: np.ndarray,
    command_log_time_ns: np.ndarray,
    commands: np.ndarray,
    velocities: np.ndarray | None = None,
    target_poses: TargetPoses | None = None,
    channels: Mapping[str, ChannelSamples] | None = None,
    compression: str = "zstd",
) -> None:
    """Write one bag with the machine's topics; the folder appears complete or not at all.

    Args:
        path: The bag's folder, which must not exist yet.
        machine: Gives topics and the kind of commands: `std_msgs/Int8MultiArray` where they are discrete,
            `std_msgs/Float32MultiArray` where they are continuous.
        joint_state_header_stamp_ns: Sample time of each joint state, shape (N,), int64.
        joint_state_log_time_ns: Log time of each joint state, shape (N,), int64.
        joint_names: Names in the messages, in any order; names outside the machine are allowed.
        positions: Joint positions in the order of `joint_names`, shape (N, len(joint_names)), rad or m; written as
            the machine's scale and offset have it.
        command_log_time_ns: When each command was recorded, shape (M,), int64.
        commands: Commands in the machine's joint order, shape (M, n_joint).
        velocities: Of the positions, rad/s or m/s, like them; None: the messages have none.
        target_poses: Target poses, if any were given.
        channels: Samples of the machine's channels by name, written as `std_msgs/Float64`; others are left out.
        compression: Of the chunks: `none`, `lz4` or `zstd`.

    Raises:
        InputError: The folder exists, or the compression is unknown.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; remove it or name another folder")
    if compression not in COMPRESSIONS:
        raise InputError(
            f"{path}: compression `{compression}` is unknown; use one of {', '.join(COMPRESSIONS)}"
        )
    store = get_typestore(Stores.ROS2_HUMBLE)
    names, conversion = tuple(joint_names), position_conversion(machine)
    measured = {"position": _recorded(machine, names, np.asarray(positions), conversion.recorded)}
    if velocities is not None:
        measured["velocity"] = _recorded(machine, names, np.asarray(velocities), conversion.recorded_rates)
    written = [
        _joint_states(store, machine, joint_state_header_stamp_ns, joint_state_log_time_ns, names, measured),
        _commands(store, machine, command_log_time_ns, np.asarray(commands)),
    ]
    if target_poses is not None:
        written.append(_targets(store, machine, target_poses))
    for source in machine.channels:
        if source.topic and source.name in (channels or {}):
            written.append(_channel(store, source.topic, (channels or {})[source.name]))
    partial = partial_bag(path)
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    file_name = f"{path.name}_0.mcap"
    _write_mcap(partial / file_name, store, written, COMPRESSIONS[compression])
    _write_metadata(partial / "metadata.yaml", file_name, store, written)
    partial.rename(path)


def partial_bag(path: Path) -> Path:
    """Path of a bag until it is complete; a killed process may leave it behind."""
    return path.with_name(f".{path.name}{PARTIAL_SUFFIX}")


def _joint_states(
    store: Typestore,
    machine: MachineSpecification,
    stamp_ns: np.ndarray,
    log_time_ns: np.ndarray,
    names: tuple[str, ...],
    measured: dict[str, np.ndarray],
) -> _Channel:
    type_name = "sensor_msgs/msg/JointState"
    empty = np.array([], dtype=np.float64)
    prototype = store.types[type_name](
        header=_header(store, ""),
        name=list(names),
        position=np.zeros(len(names)),
        velocity=np.zeros(len(names)) if "velocity" in measured else empty,
        effort=empty,
    )
    numbers = {
        "header.stamp.sec": (stamp_ns // NANOSECONDS)[:, None],
        "header.stamp.nanosec": (stamp_ns % NANOSECONDS)[:, None],
        **measured,
    }
    return _Channel(
        machine.joint_states.topic, type_name, log_time_ns, _serialise(store, prototype, type_name, numbers)
    )


def _recorded(
    machine: MachineSpecification,
    names: tuple[str, ...],
    values: np.ndarray,
    convert: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Turn the machine's joints among the columns into the numbers from which its `joint_states` make them."""
    conversion = position_conversion(machine)
    if conversion.scale is None and conversion.offset is None:
        return values
    columns = [names.index(joint) for joint in machine.joint_names]
    recorded = values.astype(np.float64)
    recorded[:, columns] = convert(recorded[:, columns])
    return recorded


def _commands(
    store: Typestore, machine: MachineSpecification, log_time_ns: np.ndarray, commands: np.ndarray
) -> _Channel:
    conversion = command_conversion(machine)
    is_scaled = conversion.scale is not None or conversion.offset is not None
    discrete = machine.command_kind == CommandKind.discrete and not is_scaled
    commands = conversion.recorded(commands)
    type_name = f"std_msgs/msg/{'Int8' if discrete else 'Float32'}MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    data = np.zeros(machine.n_joint, dtype=np.int8 if discrete else np.float32)
    prototype = store.types[type_name](layout=layout, data=data)
    return _Channel(
        machine.commands.topic,
        type_name,
        log_time_ns,
        _serialise(store, prototype, type_name, {"data": commands}),
    )


def _targets(store: Typestore, machine: MachineSpecification, targets: TargetPoses) -> _Channel:
    type_name = "geometry_msgs/msg/PoseStamped"
    types = store.types
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    prototype = types[type_name](header=_header(store, targets.frame_id), pose=pose)
    time_ns, position, quaternion = map(as_array, (targets.log_time_ns, targets.position, targets.quaternion))
    numbers = {
        "header.stamp.sec": (time_ns // NANOSECONDS)[:, None],
        "header.stamp.nanosec": (time_ns % NANOSECONDS)[:, None],
    }
    numbers |= {f"pose.position.{axis}": position[:, [i]] for i, axis in enumerate("xyz")}
    numbers |= {f"pose.orientation.{axis}": quaternion[:, [i]] for i, axis in enumerate("wxyz")}
    messages = _serialise(store, prototype, type_name, numbers)
    return _Channel(machine.target_topic, type_name, time_ns, messages)


def _channel(store: Typestore, topic: str, samples: ChannelSamples) -> _Channel:
    type_name = "std_msgs/msg/Float64"
    values = {"data": as_array(samples.value)[:, None]}
    messages = _serialise(store, store.types[type_name](data=0.0), type_name, values)
    return _Channel(topic, type_name, as_array(samples.time_ns), messages)


def _header(store: Typestore, frame_id: str) -> "Msg":
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _serialise(
    store: Typestore, prototype: object, type_name: str, numbers: dict[str, np.ndarray]
) -> list[bytes]:
    """Serialise the prototype and write the numbers, each of shape (n, count), into n copies of it."""
    template = bytes(store.serialize_cdr(prototype, type_name))
    definition, _ = store.generate_msgdef(type_name, ros_version=2)
    layout = layout_of(
        template, parse_definition(type_name, definition, "ros2msg"), type_name, "cdr", numbers
    )
    n_messages = len(next(iter(numbers.values())))
    data = bytearray(template * n_messages)  # NumPy skips bytes between fields, so the whole buffer is copied
    table = np.frombuffer(data, dtype=structured_view(layout))
    for path, values in numbers.items():
        table[path] = values
    length = len(template)
    return [bytes(data[start : start + length]) for start in range(0, len(data), length)]


def _write_mcap(path: Path, store: Typestore, channels: list[_Channel], compression: CompressionType) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=compression)
        writer.start(profile="ros2", library="hydraulic-arm-pipeline")
        numbers = []
        for channel in channels:
            definition, _ = store.generate_msgdef(channel.type_name, ros_version=2)
            schema = writer.register_schema(channel.type_name, "ros2msg", definition.encode())
            numbers.append(
                writer.register_channel(channel.topic, "cdr", schema, {"offered_qos_profiles": ""})
            )
        times = np.concatenate([channel.log_time_ns for channel in channels])
        sources = np.concatenate([np.full(len(channel.messages), i) for i, channel in enumerate(channels)])
        positions = np.concatenate([np.arange(len(channel.messages)) for channel in channels])
        order = np.argsort(times, kind="stable")
        rows = zip(times[order].tolist(), sources[order].tolist(), positions[order].tolist(), strict=True)
        for log_time, source, position in rows:
            message = channels[source].messages[position]
            writer.add_message(numbers[source], log_time, message, publish_time=log_time, sequence=position)
        writer.finish()


def _write_metadata(path: Path, file_name: str, store: Typestore, channels: list[_Channel]) -> None:
    times = np.concatenate([channel.log_time_ns for channel in channels])
    start, end = (int(times.min()), int(times.max())) if len(times) else (0, 0)
    span = {"duration": {"nanoseconds": end - start}, "starting_time": {"nanoseconds_since_epoch": start}}
    information = {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        **span,
        "message_count": len(times),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": channel.topic,
                    "type": channel.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [],
                    "type_description_hash": store.hash_rihs01(channel.type_name),
                },
                "message_count": len(channel.messages),
            }
            for channel in channels
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **span, "message_count": len(times)}],
        "custom_data": None,
        "ros_distro": "humble",
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
    path.write_text(text, encoding="utf-8")
