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
from pipeline.machine.log_sources import (
    CanSource,
    ChannelSource,
    ColumnMap,
    CommandSource,
    JointStateSource,
    LeRobotSource,
)

MACHINE_DIRECTORY = Path(__file__).resolve().parents[2] / "conf" / "machine"


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


def can_database(machine: "MachineSpecification") -> Path:
    """Return the path of the DBC file that describes the machine's CAN logs."""
    return MACHINE_DIRECTORY / (machine.can.database or f"{machine.name}.dbc")


@dataclass
class JointSpecification:
    """One joint: name, kind and limits in rad (revolute) or m (prismatic)."""

    name: str
    lower: float
    upper: float
    kind: JointKind = JointKind.revolute


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
