"""The specification of a machine: the content of `conf/machine/<name>.yaml`.

Nothing outside that file and the robot description knows joint names, the number of joints, or whether
commands are discrete. The dataclasses are mutable because Hydra's structured configs must be.
"""

import enum
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.errors import InputError

MACHINE_DIRECTORY = Path(__file__).resolve().parents[2] / "conf" / "machine"

MAXIMUM_OFFSET_S = (
    3e9  # of a topic's clock; enough for one that counts from 1970 beside one that counts from zero
)


class JointKind(enum.StrEnum):
    """How a joint moves, and so the unit of its position."""

    revolute = "revolute"
    prismatic = "prismatic"

    @property
    def unit(self) -> str:
        """SI unit of the joint's position: `rad` or `m`."""
        return "rad" if self is JointKind.revolute else "m"


class CommandKind(enum.StrEnum):
    """What a joint command may be."""

    discrete = "discrete"  # one of -1, 0, 1
    continuous = "continuous"  # anything in [-1, 1]


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


def can_database(machine: "MachineSpecification") -> Path:
    """Return the path of the DBC file that describes the machine's CAN logs."""
    return MACHINE_DIRECTORY / (machine.can.database or f"{machine.name}.dbc")


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


@dataclass
class JointSpecification:
    """One joint: name, kind and limits in rad (revolute) or m (prismatic)."""

    name: str
    lower: float
    upper: float
    kind: JointKind = JointKind.revolute


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
        column: Of tables.
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


@dataclass
class WorkspaceSpecification:
    """The restricted workspace W+ (a cylindrical sector) and the grill, in frame {B}: m and rad."""

    radius_min_m: float
    radius_max_m: float
    yaw_max_rad: float
    z_min_m: float
    z_max_m: float
    grill_height_m: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.radius_min_m < self.radius_max_m:
            raise InputError(
                f"workspace: radius_min_m {self.radius_min_m} and radius_max_m {self.radius_max_m} must "
                "satisfy 0 <= radius_min_m < radius_max_m"
            )
        if not 0.0 < self.yaw_max_rad < math.pi:
            raise InputError(f"workspace: yaw_max_rad is {self.yaw_max_rad}; it must be in (0, pi)")
        if not self.z_min_m < self.z_max_m:
            raise InputError(f"workspace: z_min_m {self.z_min_m} is not below z_max_m {self.z_max_m}")


@dataclass
class ArmDescription:
    """The robot description and how its links name the end effector.

    `pitch_joints` are the joints whose angles add up to the pitch, `pitch_offset_rad` is added to the sum.
    """

    urdf: str  # path relative to conf/machine
    end_effector: str  # name of the URDF's link frame of the chisel tip
    yaw_joint: str
    pitch_joints: list[str]
    pitch_offset_rad: float


def _check_offset(section: str, clock_offset_s: float) -> None:
    if not abs(clock_offset_s) <= MAXIMUM_OFFSET_S:
        raise InputError(
            f"{section}.clock_offset_s is {clock_offset_s}; it may be at most {MAXIMUM_OFFSET_S:g} s either way"
        )


@dataclass
class MachineSpecification:
    """A machine as its configuration file states it.

    `arm` and `workspace` are absent for machines that are only identified, not controlled.
    """

    name: str
    rate_hz: float
    joints: list[JointSpecification]
    command_kind: CommandKind = CommandKind.discrete
    joint_states: JointStateSource = field(default_factory=JointStateSource)
    commands: CommandSource = field(default_factory=CommandSource)
    columns: ColumnMap = field(default_factory=ColumnMap)
    can: CanSource = field(default_factory=CanSource)
    lerobot: LeRobotSource = field(default_factory=LeRobotSource)
    target_topic: str = "/target_pose"
    channels: list[ChannelSource] = field(default_factory=list)
    arm: ArmDescription | None = None
    workspace: WorkspaceSpecification | None = None

    def __post_init__(self) -> None:
        if isinstance(self.joints, str) or any(
            not isinstance(joint, JointSpecification) for joint in self.joints
        ):
            return  # OmegaConf builds the node first and the object later
        names = self.joint_names
        if not names:
            raise InputError(f"conf/machine/{self.name}.yaml: joints is empty; list at least one joint")
        if len(set(names)) != len(names):
            raise InputError(f"conf/machine/{self.name}.yaml: joints repeat a name: {', '.join(names)}")
        for joint in self.joints:
            if not joint.lower < joint.upper:
                raise InputError(
                    f"conf/machine/{self.name}.yaml: joint {joint.name}: lower {joint.lower} is not below "
                    f"upper {joint.upper}"
                )
        if len(set(self.channel_names)) != len(self.channels):
            raise InputError(
                f"conf/machine/{self.name}.yaml: channels repeat a name: {', '.join(self.channel_names)}"
            )
        if not self.rate_hz > 0:
            raise InputError(f"conf/machine/{self.name}.yaml: rate_hz is {self.rate_hz}; it must be positive")

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the machine's joint order, which every array's last axis follows."""
        return tuple(joint.name for joint in self.joints)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(channel.name for channel in self.channels)

    @property
    def n_joint(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def dt_s(self) -> float:
        """Time step, s."""
        return 1.0 / self.rate_hz

    @property
    def lower(self) -> np.ndarray:
        """Lower joint limits, shape (n_joint,), float64, rad or m."""
        return np.array([joint.lower for joint in self.joints], dtype=np.float64)

    @property
    def upper(self) -> np.ndarray:
        """Upper joint limits, shape (n_joint,), float64, rad or m."""
        return np.array([joint.upper for joint in self.joints], dtype=np.float64)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's position."""
        return tuple(JointKind(joint.kind).unit for joint in self.joints)

    @property
    def error_scale(self) -> np.ndarray:
        """Divisor of position errors before they are summed over joints, shape (n_joint,).

        One where all joints share a unit (the paper's loss); the joint range where units are mixed
        (contract, section 4).
        """
        if len(set(self.units)) == 1:
            return np.ones(self.n_joint)
        return self.upper - self.lower
