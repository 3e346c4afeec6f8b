"""Joint positions and target poses from messages."""

from functools import partial

import numpy as np

from pipeline.logs.messages.adapters import Converted, FieldColumn, NamedColumn, Stamped
from pipeline.logs.messages.conversion import position_conversion
from pipeline.logs.messages.decoding.field_paths import SELF_DESCRIBING
from pipeline.logs.messages.decoding.layout import FieldGroup
from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.topic_columns import Adapter
from pipeline.machine.log_sources import per_joint
from pipeline.machine.specification import MachineSpecification

ROLE = "joint states"
ROS_TYPE = "sensor_msgs/msg/JointState"
FOXGLOVE_TYPE = "foxglove.JointStates"
FOXGLOVE_NAMES = "joints[].name"


def joint_state_adapter(machine: MachineSpecification) -> Adapter:
    """Return the adapter of the machine's joint states → columns `q` (n, n_joint), and `stamp_ns` (n,).

    Stamps are zero where the messages lack them; log time then replaces them.

    Raises:
        InputError: The configuration lists another number of fields than the machine has joints.
    """
    source, place = machine.joint_states, f"conf/machine/{machine.name}.yaml: joint_states"
    if source.field_paths:
        paths = per_joint(source.field_paths, machine.joint_names, f"{place}.field_paths")
        adapter: Adapter = FieldColumn(ROLE, "q", paths)
    else:
        adapter = NamedColumn(ROLE, "q", machine.joint_names, partial(joint_fields, field_name="position"))
    return Stamped(Converted(adapter, "q", position_conversion(machine)), source.stamp, is_needed=False)


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
