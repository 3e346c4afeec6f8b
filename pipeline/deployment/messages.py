"""Messages between the graph's components: topics and typed messages, independent of any transport.

Arrays follow the machine's joint order; times are nanoseconds of the sender's clock. ROS 1 carries the same
messages (`pipeline.deployment.transports.ros1`).
"""

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


class Topic(enum.StrEnum):
    """Names of the graph's topics. Three of them are the machine's in the logs: `conf/machine/*.yaml` names those."""

    joint_states = "joint_states"  # JointState, driver -> servers, supervisor
    joystick = "joystick"  # Joystick, operator -> teleoperation_server
    goal = "reach_goal"  # ReachGoal, operator -> autonomous_server
    cancel = "reach_cancel"  # CancelGoal, operator -> autonomous_server
    result = "reach_result"  # ReachResult, autonomous_server -> operator
    target_pose = "target_pose"  # TargetPose, autonomous_server -> logs
    requested_commands = (
        "requested_commands"  # JointCommand, servers -> control_supervisor, control_interface
    )
    joint_commands = "joint_commands"  # MachineCommand, control_interface -> drivers, logs
    emergency_stop = "emergency_stop"  # EmergencyStop, control_supervisor, control_interface -> all that act
    reset = "reset"  # Reset, operator -> control_supervisor
    release = "release"  # Release, control_supervisor -> all that act
    supervisor_state = "supervisor_state"  # SupervisorState, control_supervisor -> control_interface
    can_to_machine = "can_to_machine"  # CanFrame, bobcat_e10_driver -> emcb_200u_driver
    can_from_machine = "can_from_machine"  # CanFrame, emcb_200u_driver -> bobcat_e10_driver
    diagnostics = "diagnostics"  # Diagnostics, every component -> logs, viewers
    machine_outputs = "machine_outputs"  # MachineOutputs, simulated PLC -> stop timing


@dataclass(frozen=True, eq=False)
class JointState:
    """Positions, rad (m), and velocity estimates, rad/s (m/s), each (n_joint,); stamp: time of sampling."""

    stamp_ns: int
    position: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True, eq=False)
class Joystick:
    """Stick deflections in [-1, 1], one per axis of the device."""

    stamp_ns: int
    axes: np.ndarray


@dataclass(frozen=True, eq=False)
class ReachGoal:
    """A target pose of the end effector in {B}: m (3,) and quaternion (w, x, y, z) (4,)."""

    goal_id: int
    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True)
class CancelGoal:
    """The operator cancels a goal."""

    goal_id: int


class GoalOutcome(enum.StrEnum):
    """How the pursuit of a goal ended."""

    reached = "reached"
    left_workspace = "left_workspace"
    oscillated = "oscillated"
    timed_out = "timed_out"
    cancelled = "cancelled"
    stopped = "stopped"  # by an emergency stop
    controller_failed = "controller_failed"
    refused = "refused"  # the pose is unreachable


@dataclass(frozen=True)
class ReachResult:
    """End of a goal, with the number of the server's ticks."""

    stamp_ns: int
    goal_id: int
    outcome: GoalOutcome
    n_ticks: int


@dataclass(frozen=True, eq=False)
class TargetPose:
    """The target pose from now on, in the form of logs."""

    stamp_ns: int
    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True, eq=False)
class JointCommand:
    """A server's command request.

    Attributes:
        stamp_ns: time of sending.
        source: name of the server.
        sequence: counts this server's commands.
        observed_ns: stamp of the decision's joint state; for an operator's command, the time of sending.
        values: (n_joint,), {-1, 0, 1} or [-1, 1].
        is_last: whether the server sends nothing after it.
    """

    stamp_ns: int
    source: str
    sequence: int
    observed_ns: int
    values: np.ndarray
    is_last: bool = False


@dataclass(frozen=True, eq=False)
class MachineCommand:
    """Command for the machine's driver, (n_joint,)."""

    stamp_ns: int
    values: np.ndarray


@dataclass(frozen=True)
class EmergencyStop:
    """A stop, which its stamp identifies: the violated rule, and details."""

    stamp_ns: int
    rule: str
    detail: str


class InterfaceRule(enum.StrEnum):
    """Rules of the control interface itself; all others are the supervisor's."""

    supervisor_silence = "supervisor_silence"
    invalid_command = "invalid_command"


@dataclass(frozen=True)
class Reset:
    """The operator acknowledges the stop with the stamp `stop_ns`."""

    stamp_ns: int
    stop_ns: int


@dataclass(frozen=True)
class Release:
    """The supervisor ends the stop with the stamp `stop_ns`, and all before it."""

    stamp_ns: int
    stop_ns: int


@dataclass(frozen=True)
class SupervisorState:
    """Sign of life of the supervisor; rule and stamp of the stop in force, empty and 0 without one."""

    stamp_ns: int
    rule: str
    stop_ns: int = 0


class Level(enum.IntEnum):
    """How a component is, in the numbers of ROS's `diagnostic_msgs/DiagnosticStatus`."""

    ok = 0
    warning = 1
    error = 2
    stale = 3


@dataclass(frozen=True)
class Status:
    """What a component, or a part of one, tells of itself.

    Attributes:
        source: its name.
        level: how it is.
        text: the same in words.
        values: details by name.
    """

    source: str
    level: Level
    text: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Diagnostics:
    """A component's own status, one of them; other programs' nodes may send several at once."""

    stamp_ns: int
    statuses: Sequence[Status]


@dataclass(frozen=True)
class CanFrame:
    """A CAN frame: identifier and up to eight bytes."""

    stamp_ns: int
    identifier: int
    data: bytes


@dataclass(frozen=True, eq=False)
class MachineOutputs:
    """Valve outputs of the simulated PLC from now on, (n_joint,)."""

    stamp_ns: int
    values: np.ndarray


Message = (
    JointState
    | Joystick
    | ReachGoal
    | CancelGoal
    | ReachResult
    | TargetPose
    | JointCommand
    | MachineCommand
    | EmergencyStop
    | Reset
    | Release
    | SupervisorState
    | Diagnostics
    | CanFrame
    | MachineOutputs
)
