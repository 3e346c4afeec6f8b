"""Joint positions and target poses from messages."""

import numpy as np

from pipeline.logs.messages.conversion import ConvertedColumn, position_conversion
from pipeline.logs.messages.field_paths import SELF_DESCRIBING, number_at, stamp_paths, stamps_ns
from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.message_layout import FieldGroup, LayoutError
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.topic_columns import Adapter
from pipeline.machine.log_sources import per_joint
from pipeline.machine.specification import MachineSpecification

ROLE = "joint states"
ROS_TYPE = "sensor_msgs/msg/JointState"
FOXGLOVE_TYPE = "foxglove.JointStates"
FOXGLOVE_NAMES = "joints[].name"


def joint_state_adapter(machine: MachineSpecification) -> Adapter:
    """Return the adapter of the machine's joint states.

    Raises:
        InputError: The configuration lists another number of fields than the machine has joints.
    """
    source, place = machine.joint_states, f"conf/machine/{machine.name}.yaml: joint_states"
    if not source.field_paths:
        adapter: Adapter = JointStateAdapter(machine.joint_names)
    else:
        paths = per_joint(source.field_paths, machine.joint_names, f"{place}.field_paths")
        adapter = FieldPathJointStates(paths, source.stamp)
    return ConvertedColumn(adapter, "q", position_conversion(machine))


def joint_fields(topic: LoggedTopic, field_name: str) -> tuple[str, str]:
    """Return the paths of the joints' names and of one of their fields.

    Raises:
        MismatchError: The messages are of another type.
    """
    tells_its_fields = topic.encoding in SELF_DESCRIBING
    if topic.type_name == ROS_TYPE or (tells_its_fields and topic.type_name.endswith(".JointState")):
        return "name", field_name
    if tells_its_fields and topic.type_name == FOXGLOVE_TYPE:
        return FOXGLOVE_NAMES, f"joints[].{field_name}"
    raise MismatchError(f"they are {topic.type_name or 'of no named type'}, not {ROS_TYPE}")


def by_name(
    names: tuple[str, ...], values: np.ndarray, joint_names: tuple[str, ...], field_name: str
) -> np.ndarray:
    """Return the values of the machine's joints, picked by the names of all, shape (n, n_joint), float64.

    Raises:
        MismatchError: A joint is missing or listed twice, or there are more or fewer values than names.
    """
    missing = [joint for joint in joint_names if joint not in names]
    if missing:
        raise MismatchError(
            f"joint {', '.join(missing)} is missing; names in the messages: {', '.join(names) or 'none'}"
        )
    repeated = [joint for joint in joint_names if names.count(joint) > 1]
    if repeated:
        raise MismatchError(f"joint {', '.join(repeated)} stands there more than once: {', '.join(names)}")
    if values.shape[1] != len(names):
        raise MismatchError(
            f"their field `{field_name}` holds {values.shape[1]} values for {len(names)} names"
        )
    return values[:, [names.index(joint) for joint in joint_names]].astype(np.float64)


class JointStateAdapter:
    """`sensor_msgs/JointState`, `foxglove.JointStates` → columns `stamp_ns` (n,), `q` (n, n_joint) in joint order."""

    role = ROLE

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self.joint_names = joint_names
        self.paths = ("", "")  # of names and positions, in the last block

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """Stamp, names and positions."""
        self.paths = joint_fields(topic, "position")
        return (*stamp_paths(), *self.paths)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick the machine's joints by name."""
        names, positions = self.paths
        q = by_name(group.text(names), group.sequence(positions), self.joint_names, positions)
        return {"stamp_ns": _stamps_if_any(group), "q": q}


class FieldPathJointStates:
    """Any message: one field per joint, by path, and the path of the time stamp."""

    role = ROLE

    def __init__(self, paths: list[str], stamp: str) -> None:
        self.paths = paths
        self.stamp = stamp

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """The paths, and those of the time stamp."""
        return (*self.paths, *stamp_paths(self.stamp))

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick each path's value."""
        q = np.stack([number_at(group, path) for path in self.paths], axis=1)
        return {"stamp_ns": _stamps_if_any(group, self.stamp), "q": q}


def _stamps_if_any(group: FieldGroup, place: str = "") -> np.ndarray:
    """The time stamps, shape (n,), int64; zero where the messages lack them, which log time then replaces."""
    try:
        return stamps_ns(group, place)
    except LayoutError:
        return np.zeros(len(group.index), np.int64)


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
