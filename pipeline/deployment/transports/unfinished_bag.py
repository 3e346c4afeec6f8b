"""What a recorder has heard so far, as a file beside the bag that it writes at the end; a killed recorder leaves it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores
from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.components.recording import BASE_FRAME
from pipeline.deployment.graph_logs.graph_topics import KINDS, graph_store
from pipeline.deployment.messages import JointState, MachineCommand, Message, TargetPose, Topic
from pipeline.logs.messages.conversion import command_conversion, position_conversion
from pipeline.machine.specification import CommandKind, MachineSpecification


def unfinished(bag: Path) -> Path:
    """The file of what is heard until the bag is written."""
    return bag.with_name(f"{bag.name}_unfinished.mcap")


class UnfinishedBag:
    """A tap that writes each message of the bag's topics at once; without chunks, so that nothing waits in memory.

    The file is a log as any other. Whoever has written the bag deletes it.
    """

    def __init__(self, path: Path, machine: MachineSpecification) -> None:
        """The file appears with the first message."""
        self._path, self._machine = path, machine
        self._store = graph_store(Stores.ROS2_HUMBLE)
        self._writer: Writer | None = None
        self._channels: dict[str, int] = {}

    def __call__(self, topic: Topic, message: Message, time_ns: int) -> None:
        """Write a message."""
        if topic in KINDS:
            kind = KINDS[topic]
            self._write(f"/{topic}", kind.type_name, kind.ros(self._store, message), time_ns)
        elif isinstance(message, JointState | MachineCommand | TargetPose):
            self._write(*_of_logs(self._store, self._machine, message), time_ns)

    def _write(self, name: str, type_name: str, ros: "Msg", time_ns: int) -> None:
        if self._writer is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self._path.open("wb")
            self._writer = Writer(self._stream, use_chunking=False)
            self._writer.start(profile="ros2", library="hydraulic-arm-pipeline")
        if name not in self._channels:
            definition, _ = self._store.generate_msgdef(type_name, ros_version=2)
            schema = self._writer.register_schema(type_name, "ros2msg", definition.encode())
            self._channels[name] = self._writer.register_channel(name, "cdr", schema)
        data = bytes(self._store.serialize_cdr(ros, type_name))
        self._writer.add_message(self._channels[name], time_ns, data, publish_time=time_ns)
        self._stream.flush()


def _of_logs(
    store: Typestore, machine: MachineSpecification, message: JointState | MachineCommand | TargetPose
) -> tuple[str, str, "Msg"]:
    """A message on a topic of every log, as `write_bag` writes it: the topic's name, its type, the ROS message."""
    types = store.types
    if isinstance(message, MachineCommand):
        conversion = command_conversion(machine)
        is_scaled = conversion.scale is not None or conversion.offset is not None
        is_discrete = machine.command_kind is CommandKind.discrete and not is_scaled
        data = conversion.recorded(np.asarray(message.values, float)[None])[0]
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        name = f"std_msgs/msg/{'Int8' if is_discrete else 'Float32'}MultiArray"
        ros = types[name](layout=layout, data=data.astype(np.int8 if is_discrete else np.float32))
        return machine.commands.topic, name, ros
    seconds, nanoseconds = divmod(message.stamp_ns, NANOSECONDS)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)

    def header(frame: str) -> Any:
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    if isinstance(message, JointState):
        empty, name = np.array([], float), "sensor_msgs/msg/JointState"
        conversion = position_conversion(machine)
        q = conversion.recorded(np.asarray(message.position, float)[None])[0]
        qd = conversion.recorded_rates(np.asarray(message.velocity, float)[None])[0]
        ros = types[name](
            header=header(""), name=list(machine.joint_names), position=q, velocity=qd, effort=empty
        )
        return machine.joint_states.topic, name, ros
    name, (x, y, z), (w, *v) = "geometry_msgs/msg/PoseStamped", message.position, message.quaternion
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=float(x), y=float(y), z=float(z)),
        orientation=types["geometry_msgs/msg/Quaternion"](
            x=float(v[0]), y=float(v[1]), z=float(v[2]), w=float(w)
        ),
    )
    return machine.target_topic, name, types[name](header=header(BASE_FRAME), pose=pose)
