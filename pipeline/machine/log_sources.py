"""Where a machine's joint states, commands and channels stand in logs: sections of `conf/machine/<name>.yaml`.

The dataclasses are mutable because Hydra's structured configs must be.
"""

import enum
import math
from dataclasses import dataclass, field

from pipeline.errors import InputError

MAXIMUM_OFFSET_S = (
    3e9  # of a topic's clock: enough for one that counts from 1970 beside one that counts from zero
)


class CommandSourceKind(enum.StrEnum):
    """Message format of the commands in the logs (contract, section 1)."""

    array = (
        "array"  # Int8MultiArray, Float32MultiArray, Float64MultiArray: one value per joint, in joint order
    )
    joy = "joy"  # sensor_msgs/Joy: axes with sign and threshold
    joint_state = "joint_state"  # sensor_msgs/JointState: by joint name, one of its fields
    named = "named"  # any message that names its joints, by joint name
    field_path = "field_path"  # any message whose definition the bag carries


class ClockChoice(enum.StrEnum):
    """Which clock times the messages of a topic."""

    automatic = (
        "automatic"  # header stamps, unless the log shows that they cannot be right; of joint states only
    )
    header_stamp = "header_stamp"
    log_time = "log_time"  # when the recorder received the message


@dataclass
class JointStateSource:
    """Where joint positions stand in the logs, and the clock that times them.

    Attributes:
        field_paths: For messages that are not joint states: one path per joint ("arm.angle", "data[3]"), or one for
            all in which `{joint}` stands for the joint's name.
        stamp: Path of the sample time in messages; empty: `header.stamp` or `timestamp`.
        scale: Per joint or one for all: position = scale × number in the log + offset.
        offset: Likewise, rad or m.
        clock_offset_s: Added to that clock's times (not to log time where it replaces unusable stamps).
    """

    topic: str = "/joint_states"
    field_paths: list[str] = field(default_factory=list)
    stamp: str = ""
    scale: list[float] = field(default_factory=list)
    offset: list[float] = field(default_factory=list)
    clock: ClockChoice = ClockChoice.automatic
    clock_offset_s: float = 0.0

    def __post_init__(self) -> None:
        _check_offset("joint_states", self.clock_offset_s)


@dataclass
class CommandSource:
    """Where commands stand in the logs, and how they become one value per joint in [-1, 1]."""

    topic: str = "/joint_commands"
    source: CommandSourceKind = CommandSourceKind.array
    clock: ClockChoice = ClockChoice.log_time
    clock_offset_s: float = 0.0  # added to that clock's times
    # joy: one axis index per joint, sign per joint; the threshold of the paper's interpreter (joy must have it)
    axes: list[int] = field(default_factory=list)
    signs: list[float] = field(default_factory=list)
    threshold: float | None = None
    # command = scale × number in the log + offset, per joint or one for all, before the threshold
    scale: list[float] = field(default_factory=list)
    offset: list[float] = field(default_factory=list)
    # named: paths of the joints' names and of their values ("joint_names", "points[0].velocities"; "joints[].name")
    names: str = ""
    values: str = ""
    # joint_state: which field; field_path: one path per joint ("left.x", "data[3]")
    field_name: str = "velocity"
    field_paths: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        _check_offset("commands", self.clock_offset_s)
        if self.clock == ClockChoice.automatic:
            raise InputError("commands.clock is automatic; use header_stamp or log_time")
        if self.threshold is not None and not 0 <= self.threshold < math.inf:
            raise InputError(
                f"commands.threshold is {self.threshold}; it must be a number that is not negative"
            )


@dataclass
class ColumnMap:
    """Columns of CSV and Parquet logs. `{joint}` stands for the joint's name."""

    time: str = "t"
    time_unit: str = "s"
    position: str = "q_{joint}"
    command: str = "a_{joint}"


@dataclass
class ChannelSource:
    """Another quantity that the machine records: a field of a topic, a column of tables, or both.

    Attributes:
        name: The tuples have it as column `x_<name>`.
        topic: Of bags; the frame of CAN logs.
        field: Path of the number in the topic's messages ("data", "fluid_pressure", "cells[2].voltage"); the signal.
        column: Of tables; of LeRobot datasets `FEATURE.NAME` or `FEATURE[3]`.
        unit: As in the log; values are not converted.
        clock: `log_time` or `header_stamp`.
        hold_s: How long a value holds where no further one is received.
    """

    name: str
    topic: str = ""
    field: str = ""
    column: str = ""
    unit: str = ""
    clock: ClockChoice = ClockChoice.log_time
    hold_s: float = 5.0

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise InputError(f"channels: the name `{self.name}` may hold letters, digits and _ only")
        if not (self.column or (self.topic and self.field)):
            raise InputError(f"channels: {self.name} needs a topic and a field, or a column")
        if not 0 < self.hold_s < math.inf:
            raise InputError(f"channels: hold_s of {self.name} is {self.hold_s}; it must be positive")
        if self.clock == ClockChoice.automatic:
            raise InputError(f"channels: clock of {self.name} is automatic; use header_stamp or log_time")


@dataclass
class CanSource:
    """Where positions and commands stand in CAN logs, as `FRAME.SIGNAL` of a DBC file.

    Attributes:
        database: The DBC file, relative to conf/machine; empty: `<name>.dbc`.
        bus: Only frames of this bus, as the log names it (`can0`, `1`); empty: all.
        positions: One per joint, or one for all in which `{joint}` stands for the joint's name.
        commands: Likewise.
    """

    database: str = ""
    bus: str = ""
    positions: list[str] = field(default_factory=lambda: ["ENCODERS.position_{joint}"])
    commands: list[str] = field(default_factory=lambda: ["COMMAND.command_{joint}"])


@dataclass
class LeRobotSource:
    """Where positions and commands stand in LeRobot datasets.

    Attributes:
        positions: `FEATURE.NAME` or `FEATURE[3]`, one per joint, or one for all in which `{joint}` stands for the
            joint's name.
        commands: Likewise.
    """

    positions: list[str] = field(default_factory=lambda: ["observation.state.{joint}"])
    commands: list[str] = field(default_factory=lambda: ["action.{joint}"])


def per_joint(entries: list[str], joint_names: tuple[str, ...], place: str) -> list[str]:
    """Return what the machine's file says of each joint.

    Args:
        entries: One per joint, or one for all in which `{joint}` stands for the joint's name.
        joint_names: In the machine's joint order.
        place: Where the entries stand, for the message.

    Raises:
        InputError: There is another number of entries.
    """
    if len(entries) == 1 and "{joint}" in entries[0]:
        return [entries[0].replace("{joint}", joint) for joint in joint_names]
    if len(entries) != len(joint_names):
        raise InputError(f"{place} has {len(entries)} entries; list one per joint ({len(joint_names)})")
    return list(entries)


def _check_offset(section: str, clock_offset_s: float) -> None:
    if not abs(clock_offset_s) <= MAXIMUM_OFFSET_S:
        raise InputError(
            f"{section}.clock_offset_s is {clock_offset_s}; it may be at most {MAXIMUM_OFFSET_S:g} s either way"
        )
