"""Adapters for every kind of command message that a machine's configuration may name (contract, section 1).

Each source is an adapter that yields the column `command`, shape (n, n_joint), in the machine's joint order.
"""

import re
from functools import partial

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.messages.adapters import Converted, FieldColumn, NamedColumn, Stamped
from pipeline.logs.messages.conversion import command_conversion
from pipeline.logs.messages.decoding.layout import FieldGroup
from pipeline.logs.messages.joint_states import joint_fields
from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.topic_columns import Adapter
from pipeline.machine.log_sources import ClockChoice, CommandSourceKind, per_joint
from pipeline.machine.specification import CommandKind, MachineSpecification

ROLE = "commands"
FIELDS = ("position", "velocity", "effort")  # of joint states
ARRAY_TYPE = re.compile(r"std_msgs(/msg/|\.)\w+MultiArray")  # the latter in Protobuf


def command_adapter(machine: MachineSpecification) -> Adapter:
    """Return the adapter of the machine's command source; with the column `stamp_ns` if header stamps time them.

    Raises:
        InputError: The source's configuration is incomplete.
    """
    adapter = Converted(_source_adapter(machine), "command", command_conversion(machine))
    return Stamped(adapter) if machine.commands.clock == ClockChoice.header_stamp else adapter


def _source_adapter(machine: MachineSpecification) -> Adapter:
    source, place = machine.commands, f"conf/machine/{machine.name}.yaml: commands"
    match CommandSourceKind(source.source):
        case CommandSourceKind.array:
            return ArrayCommands(machine.n_joint)
        case CommandSourceKind.joy:
            for key, listed in (("axes", source.axes), ("signs", source.signs)):
                if len(listed) != machine.n_joint:
                    raise InputError(
                        f"{place}.{key} has {len(listed)} entries; list one per joint ({machine.n_joint})"
                    )
            if machine.command_kind == CommandKind.discrete and source.threshold is None:
                raise InputError(
                    f"{place}.threshold is missing; state from which deflection on a stick is a command"
                )
            return JoyCommands(list(source.axes), np.array(source.signs, dtype=np.float64))
        case CommandSourceKind.joint_state:
            if source.field_name not in FIELDS:
                raise InputError(
                    f"{place}.field_name is `{source.field_name}`; use one of {', '.join(FIELDS)}"
                )
            fields = partial(joint_fields, field_name=source.field_name)
            return NamedColumn(ROLE, "command", machine.joint_names, fields)
        case CommandSourceKind.named:
            for key, path in (("names", source.names), ("values", source.values)):
                if not path:
                    raise InputError(f"{place}.{key} is missing; name the field, such as joint_names")
            return NamedColumn(ROLE, "command", machine.joint_names, lambda _: (source.names, source.values))
        case CommandSourceKind.field_path:
            paths = per_joint(source.field_paths, machine.joint_names, f"{place}.field_paths")
            return FieldColumn(ROLE, "command", paths)


class ArrayCommands:
    """`std_msgs/…MultiArray`: one value per joint, in joint order."""

    role = ROLE

    def __init__(self, n_joint: int) -> None:
        self.n_joint = n_joint

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """The values."""
        if not ARRAY_TYPE.fullmatch(topic.type_name):
            raise MismatchError(
                f"they are {topic.type_name}, not an array; set commands.source in conf/machine"
            )
        return ("data",)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Return the values unchanged."""
        data = group.sequence("data")
        if data.shape[1] != self.n_joint:
            raise MismatchError(f"they hold {data.shape[1]} values, the machine has {self.n_joint} joints")
        return {"command": data.astype(np.float64)}


class JoyCommands:
    """`sensor_msgs/Joy`: one signed stick axis per joint."""

    role = ROLE
    type_name = "sensor_msgs/msg/Joy"

    def __init__(self, axes: list[int], signs: np.ndarray) -> None:
        self.axes = axes
        self.signs = signs

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """All axes."""
        if topic.type_name != self.type_name:
            raise MismatchError(f"they are {topic.type_name}, not {self.type_name}")
        return ("axes",)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick the axes, apply the signs."""
        axes = group.sequence("axes")
        absent = [axis for axis in self.axes if not 0 <= axis < axes.shape[1]]
        if absent:
            raise MismatchError(f"axis {absent[0]} is not among their {axes.shape[1]} axes")
        return {"command": axes[:, self.axes].astype(np.float64) * self.signs}
