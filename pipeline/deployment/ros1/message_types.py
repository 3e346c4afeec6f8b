"""Messages as ROS 1 messages, there and back: standard types where there are any, our own for the rest.

Our own types are made from their definitions when a node starts (`genpy.dynamic`); bags carry the definitions, so any
ROS tool can read them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.messages import (
    CancelGoal,
    EmergencyStop,
    JointCommand,
    JointState,
    Joystick,
    MachineCommand,
    Message,
    Outcome,
    ReachGoal,
    ReachResult,
    SupervisorState,
    TargetPose,
    Topic,
)
from pipeline.deployment.recording import BASE_FRAME
from pipeline.deployment.ros1.installation import require_ros
from pipeline.machine.specification import CommandKind, MachineSpecification

PACKAGE = "hydraulic_arm"
DEFINITIONS = {
    "JointCommand": "time stamp\nstring source\nuint32 sequence\ntime observed\nfloat32[] values\nbool is_last\n",
    "EmergencyStop": "time stamp\nstring rule\nstring detail\n",
    "SupervisorState": "time stamp\nstring rule\n",
    "ReachGoal": "uint32 goal_id\nfloat64[3] position\nfloat64[4] quaternion # w, x, y, z\n",
    "CancelGoal": "uint32 goal_id\n",
    "ReachResult": "time stamp\nuint32 goal_id\nstring outcome\nuint32 n_ticks\n",
}


class Carrier(NamedTuple):
    """How a topic's messages travel: name, ROS type, and both conversions (the second is given the arrival, ns)."""

    name: str
    ros_type: type
    to_ros: Callable[[Any], Any]
    from_ros: Callable[[Any, int], Message]


def carriers(machine: MachineSpecification) -> dict[Topic, Carrier]:
    """Carriers of all topics between processes, with the machine's names where logs have them.

    CAN frames are not among them: driver and adapter share a process on the machine's computer.

    Raises:
        InputError: ROS 1 is not installed.
    """
    rospy = require_ros()
    from genpy.dynamic import generate_dynamic
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState as RosJointState
    from sensor_msgs.msg import Joy
    from std_msgs.msg import Float32MultiArray, Int8MultiArray

    own = {
        name: generate_dynamic(f"{PACKAGE}/{name}", text)[f"{PACKAGE}/{name}"]
        for name, text in DEFINITIONS.items()
    }
    discrete = machine.command_kind is CommandKind.discrete

    def stamp(nanoseconds: int) -> Any:
        return rospy.Time(nanoseconds // NANOSECONDS, nanoseconds % NANOSECONDS)

    def joint_state(message: JointState) -> Any:
        ros = RosJointState(
            name=machine.joint_names,
            position=message.position.tolist(),
            velocity=np.asarray(message.velocity).tolist(),
        )
        ros.header.stamp = stamp(message.stamp_ns)
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
        ros = PoseStamped()
        ros.header.stamp, ros.header.frame_id = stamp(message.stamp_ns), BASE_FRAME
        for axis, value in zip("xyz", message.position, strict=True):
            setattr(ros.pose.position, axis, float(value))
        for axis, value in zip("wxyz", message.quaternion, strict=True):
            setattr(ros.pose.orientation, axis, float(value))
        return ros

    def read_target_pose(ros: Any, now_ns: int) -> TargetPose:
        position = np.array([getattr(ros.pose.position, axis) for axis in "xyz"])
        quaternion = np.array([getattr(ros.pose.orientation, axis) for axis in "wxyz"])
        return TargetPose(ros.header.stamp.to_nsec(), position, quaternion)

    def joystick(message: Joystick) -> Any:
        ros = Joy(axes=np.asarray(message.axes).tolist())
        ros.header.stamp = stamp(message.stamp_ns)
        return ros

    table: dict[Topic, tuple[type, Callable[[Any], Any], Callable[[Any, int], Message]]] = {
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
        Topic.requested_commands: (
            own["JointCommand"],
            lambda m: own["JointCommand"](
                stamp(m.stamp_ns), m.source, m.sequence, stamp(m.observed_ns), m.values.tolist(), m.is_last
            ),
            lambda ros, now_ns: JointCommand(
                ros.stamp.to_nsec(),
                ros.source,
                ros.sequence,
                ros.observed.to_nsec(),
                np.array(ros.values, np.float32),
                ros.is_last,
            ),
        ),
        Topic.emergency_stop: (
            own["EmergencyStop"],
            lambda m: own["EmergencyStop"](stamp(m.stamp_ns), m.rule, m.detail),
            lambda ros, now_ns: EmergencyStop(ros.stamp.to_nsec(), ros.rule, ros.detail),
        ),
        Topic.supervisor_state: (
            own["SupervisorState"],
            lambda m: own["SupervisorState"](stamp(m.stamp_ns), m.rule),
            lambda ros, now_ns: SupervisorState(ros.stamp.to_nsec(), ros.rule),
        ),
        Topic.goal: (
            own["ReachGoal"],
            lambda m: own["ReachGoal"](
                m.goal_id, list(map(float, m.position)), list(map(float, m.quaternion))
            ),
            lambda ros, now_ns: ReachGoal(ros.goal_id, np.array(ros.position), np.array(ros.quaternion)),
        ),
        Topic.cancel: (
            own["CancelGoal"],
            lambda m: own["CancelGoal"](m.goal_id),
            lambda ros, now_ns: CancelGoal(ros.goal_id),
        ),
        Topic.result: (
            own["ReachResult"],
            lambda m: own["ReachResult"](stamp(m.stamp_ns), m.goal_id, m.outcome.value, m.n_ticks),
            lambda ros, now_ns: ReachResult(
                ros.stamp.to_nsec(), ros.goal_id, Outcome(ros.outcome), ros.n_ticks
            ),
        ),
    }
    names = {
        Topic.joint_states: machine.joint_states.topic,
        Topic.joint_commands: machine.commands.topic,
        Topic.target_pose: machine.target_topic,
    }
    return {topic: Carrier(names.get(topic, f"/{topic}"), *entry) for topic, entry in table.items()}
