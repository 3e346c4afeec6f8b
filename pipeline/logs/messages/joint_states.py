"""Joint positions and target poses from ROS messages."""

import numpy as np

from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.message_layout import FieldGroup
from pipeline.logs.messages.raw_log import NANOSECONDS
from pipeline.logs.messages.topic_columns import MismatchError

STAMP = ("header.stamp.sec", "header.stamp.nanosec")


def stamps_ns(group: FieldGroup) -> np.ndarray:
    """Return the header stamps of decoded messages, shape (n,), int64."""
    seconds = group.number("header.stamp.sec").astype(np.int64)
    return seconds * NANOSECONDS + group.number("header.stamp.nanosec").astype(np.int64)


def select_joints(names: tuple[str, ...], joint_names: tuple[str, ...]) -> list[int]:
    """Return the position of each machine joint in a message's names.

    Raises:
        MismatchError: A joint is missing or listed twice.
    """
    missing = [joint for joint in joint_names if joint not in names]
    if missing:
        raise MismatchError(
            f"joint {', '.join(missing)} is missing; names in the messages: {', '.join(names) or 'none'}"
        )
    repeated = [joint for joint in joint_names if names.count(joint) > 1]
    if repeated:
        raise MismatchError(f"joint {', '.join(repeated)} stands there more than once: {', '.join(names)}")
    return [names.index(joint) for joint in joint_names]


class JointStateAdapter:
    """`sensor_msgs/JointState` → columns `stamp_ns` (n,) and `q` (n, n_joint) in joint order."""

    role = "joint states"
    type_name = "sensor_msgs/msg/JointState"

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self.joint_names = joint_names

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """Stamp, names and positions."""
        if topic.type_name != self.type_name:
            raise MismatchError(f"they are {topic.type_name}, not {self.type_name}")
        return (*STAMP, "name", "position")

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick the machine's joints by name."""
        names, position = group.text("name"), group.sequence("position")
        columns = select_joints(names, self.joint_names)
        if position.shape[1] != len(names):
            raise MismatchError(f"they hold {position.shape[1]} positions for {len(names)} names")
        return {"stamp_ns": stamps_ns(group), "q": position[:, columns].astype(np.float64)}


class TargetPoseAdapter:
    """`geometry_msgs/PoseStamped` → columns `position` (n, 3), `quaternion` (n, 4; wxyz); collects the frames."""

    role = "target poses"
    type_name = "geometry_msgs/msg/PoseStamped"

    def __init__(self) -> None:
        self.frame_ids: set[str] = set()

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """Frame, position and orientation."""
        if topic.type_name != self.type_name:
            raise MismatchError(f"they are {topic.type_name}, not {self.type_name}")
        axes = tuple(f"pose.position.{axis}" for axis in "xyz") + tuple(
            f"pose.orientation.{axis}" for axis in "wxyz"
        )
        return ("header.frame_id", *axes)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Collect the axes."""
        self.frame_ids.add(group.text("header.frame_id")[0])
        return {
            "position": np.stack([group.number(f"pose.position.{axis}") for axis in "xyz"], axis=1),
            "quaternion": np.stack([group.number(f"pose.orientation.{axis}") for axis in "wxyz"], axis=1),
        }
