"""Conversion of messages to and from ROS 1 messages: standard types if possible, else our own.

Goals are not sent on topics, but as an action (`reach_action`).
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.components.recording import BASE_FRAME
from pipeline.deployment.graph_logs.diagnostic_arrays import read_statuses
from pipeline.deployment.messages import (
    CanFrame,
    Diagnostics,
    EmergencyStop,
    JointCommand,
    JointState,
    Joystick,
    MachineCommand,
    MachineOutputs,
    Message,
    Release,
    Reset,
    SupervisorState,
    TargetPose,
    Topic,
)
from pipeline.deployment.transports.ros1.definitions import PACKAGE, own_types
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.machine.specification import CommandKind, MachineSpecification

MAXIMUM_CAN_BYTES = 8
OWN: dict[Topic, type] = {  # messages of our own types, which have the same name and fields
    Topic.requested_commands: JointCommand,
    Topic.emergency_stop: EmergencyStop,
    Topic.supervisor_state: SupervisorState,
    Topic.reset: Reset,
    Topic.release: Release,
    Topic.machine_outputs: MachineOutputs,
}
Conversions = tuple[
    type, Callable[[Any], Any], Callable[[Any, int], Message]
]  # the last three of a `Carrier`


class Carrier(NamedTuple):
    """Transport of a topic's messages: name, ROS type, and both conversions (the second also takes the arrival, ns)."""

    name: str
    ros_type: type
    to_ros: Callable[[Any], Any]
    from_ros: Callable[[Any, int], Message]


def ros_time(nanoseconds: int) -> Any:
    """Convert a time of the graph's clock to a ROS time."""
    import genpy

    return genpy.Time(nanoseconds // NANOSECONDS, nanoseconds % NANOSECONDS)


def fill_pose(ros: Any, stamp_ns: int, position: np.ndarray, quaternion: np.ndarray) -> Any:
    """Write a pose in {B}, m (3,) and quaternion (w, x, y, z) (4,), into a `PoseStamped`; return it."""
    ros.header.stamp, ros.header.frame_id = ros_time(stamp_ns), BASE_FRAME
    for axis, value in zip("xyz", position, strict=True):
        setattr(ros.pose.position, axis, float(value))
    for axis, value in zip("wxyz", quaternion, strict=True):
        setattr(ros.pose.orientation, axis, float(value))
    return ros


def read_pose(ros: Any) -> tuple[np.ndarray, np.ndarray]:
    """Position, m (3,), and quaternion (w, x, y, z) (4,) of a `PoseStamped`."""
    position = np.array([getattr(ros.pose.position, axis) for axis in "xyz"])
    return position, np.array([getattr(ros.pose.orientation, axis) for axis in "wxyz"])


def own_conversions(kind: type, ros_type: type) -> Conversions:
    """To and from our own type: its times lack `_ns`, its arrays are sequences of float32."""
    names = {field.name: field.name.removesuffix("_ns") for field in fields(kind)}
    return (
        ros_type,
        lambda message: ros_type(**{ros: _sent(name, getattr(message, name)) for name, ros in names.items()}),
        lambda message, now_ns: kind(
            **{name: _received(name, getattr(message, ros)) for name, ros in names.items()}
        ),
    )


def _sent(name: str, value: Any) -> Any:
    if name.endswith("_ns"):
        return ros_time(value)
    return value.tolist() if isinstance(value, np.ndarray) else value


def _received(name: str, value: Any) -> Any:
    if name.endswith("_ns"):
        return value.to_nsec()
    return np.array(value, np.float32) if isinstance(value, list | tuple) else value


def carriers(machine: MachineSpecification) -> dict[Topic, Carrier]:
    """Carriers of all topics between processes, with the machine's names for topics of logs.

    Raises:
        InputError: ROS 1 is not installed.
    """
    require_ros()
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState as RosJointState
    from sensor_msgs.msg import Joy
    from std_msgs.msg import Float32MultiArray, Int8MultiArray

    own = {name.removeprefix(f"{PACKAGE}/"): ros_type for name, ros_type in own_types().items()}
    discrete = machine.command_kind is CommandKind.discrete

    def joint_state(message: JointState) -> Any:
        ros = RosJointState(
            name=machine.joint_names,
            position=message.position.tolist(),
            velocity=np.asarray(message.velocity).tolist(),
        )
        ros.header.stamp = ros_time(message.stamp_ns)
        return ros

    def read_joint_state(ros: Any, now_ns: int) -> JointState:
        order = [ros.name.index(name) for name in machine.joint_names]
        return JointState(
            ros.header.stamp.to_nsec(), np.array(ros.position)[order], np.array(ros.velocity)[order]
        )

    def machine_command(message: MachineCommand) -> Any:
        if discrete:
            return Int8MultiArray(data=np.asarray(message.values).astype(int).tolist())
        return Float32MultiArray(data=np.asarray(message.values).tolist())

    def target_pose(message: TargetPose) -> Any:
        return fill_pose(PoseStamped(), message.stamp_ns, message.position, message.quaternion)

    def read_target_pose(ros: Any, now_ns: int) -> TargetPose:
        return TargetPose(ros.header.stamp.to_nsec(), *read_pose(ros))

    def can_frame(message: CanFrame) -> Any:
        padded = message.data.ljust(MAXIMUM_CAN_BYTES, b"\0")
        ros = own["can_msgs/Frame"](id=message.identifier, dlc=len(message.data), data=padded)
        ros.header.stamp = ros_time(message.stamp_ns)
        return ros

    def read_can_frame(ros: Any, now_ns: int) -> CanFrame:
        return CanFrame(ros.header.stamp.to_nsec(), ros.id, bytes(ros.data)[: ros.dlc])

    def joystick(message: Joystick) -> Any:
        ros = Joy(axes=np.asarray(message.axes).tolist())
        ros.header.stamp = ros_time(message.stamp_ns)
        return ros

    def diagnostic_array(message: Diagnostics) -> Any:
        make_status, pair = own["diagnostic_msgs/DiagnosticStatus"], own["diagnostic_msgs/KeyValue"]
        statuses = [
            make_status(s.level.value, s.source, s.text, "", [pair(*item) for item in s.values.items()])
            for s in message.statuses
        ]
        ros = own["diagnostic_msgs/DiagnosticArray"](status=statuses)
        ros.header.stamp = ros_time(message.stamp_ns)
        return ros

    table: dict[Topic, Conversions] = {
        Topic.joint_states: (RosJointState, joint_state, read_joint_state),
        Topic.joint_commands: (
            Int8MultiArray if discrete else Float32MultiArray,
            machine_command,
            lambda ros, now_ns: MachineCommand(now_ns, np.array(ros.data, np.float32)),
        ),
        Topic.target_pose: (PoseStamped, target_pose, read_target_pose),
        Topic.joystick: (
            Joy,
            joystick,
            lambda ros, now_ns: Joystick(ros.header.stamp.to_nsec(), np.array(ros.axes)),
        ),
        Topic.diagnostics: (
            own["diagnostic_msgs/DiagnosticArray"],
            diagnostic_array,
            lambda ros, now_ns: Diagnostics(ros.header.stamp.to_nsec(), read_statuses(ros.status)),
        ),
        Topic.can_to_machine: (own["can_msgs/Frame"], can_frame, read_can_frame),
        Topic.can_from_machine: (own["can_msgs/Frame"], can_frame, read_can_frame),
        **{topic: own_conversions(kind, own[kind.__name__]) for topic, kind in OWN.items()},
    }
    names = {
        Topic.joint_states: machine.joint_states.topic,
        Topic.joint_commands: machine.commands.topic,
        Topic.target_pose: machine.target_topic,
    }
    return {topic: Carrier(names.get(topic, f"/{topic}"), *entry) for topic, entry in table.items()}
