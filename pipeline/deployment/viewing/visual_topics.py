"""A log as topics for viewers: frames and shapes of the arm, W+, the target, commands, the graph's events.

All are standard ROS 2 types that Foxglove and Rerun support: transforms with a robot description, point clouds, joint
states (which can be plotted by joint), log messages, diagnostics.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.graph_logs.diagnostic_arrays import DIAGNOSTIC_ARRAY, diagnostic_array
from pipeline.deployment.graph_logs.graph_topics import GraphRecord
from pipeline.deployment.transports.mcap_file import RecordedTopic
from pipeline.deployment.viewing.joint_transforms import JointTransforms, joint_transforms
from pipeline.deployment.viewing.ros_messages import (
    STORE,
    cloud,
    header,
    quaternion_message,
    stamp,
    text_message,
    typed,
    vector,
)
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import RawLog
from pipeline.machine.chain import urdf_path
from pipeline.machine.sector import sector_edges
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import workspace_of

TOPICS = {
    "/robot_description": "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joints": "sensor_msgs/msg/JointState",
    "/workspace": "sensor_msgs/msg/PointCloud2",
    "/events": "rcl_interfaces/msg/Log",
    "/diagnostics": DIAGNOSTIC_ARRAY,
    "/target": "geometry_msgs/msg/PoseStamped",
    "/target_mark": "sensor_msgs/msg/PointCloud2",
}
POINT_SPACING_M = 0.01
TARGET_ARM_M = 0.1  # half the length of the cross that marks a target; the chisel's side is longer
TARGET_CHISEL_M = 0.3
LEVEL_INFORMATION, LEVEL_ERROR = 20, 40  # of rcl_interfaces/Log


def visual_topics(
    log: RawLog, graph: GraphRecord, machine: MachineSpecification, directory: Path
) -> list[RecordedTopic]:
    """All topics of a log.

    Args:
        log: joint states, commands and, if any, targets.
        graph: the graph's own messages, if recorded.
        machine: with arm and workspace.
        directory: where conf/machine lies.

    Raises:
        InputError: the machine has no arm or no workspace.
    """
    start_ns = int(as_array(log.joint_log_time_ns)[0])
    return [
        *constant_topics(machine, directory, start_ns),
        *changing_topics(log, graph, machine, directory),
    ]


def constant_topics(machine: MachineSpecification, directory: Path, time_ns: int) -> list[RecordedTopic]:
    """Constant topics, each with one message: the robot description, its fixed frames, W+.

    Args:
        machine: with arm and workspace.
        directory: where conf/machine lies.
        time_ns: time of the messages.

    Raises:
        InputError: the machine has no arm or no workspace.
    """
    urdf = urdf_path(machine, directory)
    moved = dict.fromkeys(machine.joint_names, np.zeros(2))
    fixed = [joint for joint in joint_transforms(urdf, moved) if len(joint.position) == 1]
    outline = _polylines(sector_edges(workspace_of(machine)))
    return [
        _topic("/robot_description", [(time_ns, text_message(urdf.read_text()))]),
        _topic("/tf_static", [(time_ns, _frames(fixed, 0, time_ns))]),
        _topic("/workspace", [(time_ns, cloud(outline, time_ns))]),
    ]


def changing_topics(
    log: RawLog, graph: GraphRecord, machine: MachineSpecification, directory: Path
) -> list[RecordedTopic]:
    """Topics that change, from frames to diagnostics; see `visual_topics` for the arguments."""
    time_ns, q = as_array(log.joint_log_time_ns), as_array(log.q)
    by_joint = dict(zip(machine.joint_names, q.T, strict=True))
    transforms = joint_transforms(urdf_path(machine, directory), by_joint)
    moving = [joint for joint in transforms if len(joint.position) == len(time_ns)]
    frames = [(int(t), _frames(moving, row, int(t))) for row, t in enumerate(time_ns)]
    return [
        _topic("/tf", frames),
        _topic("/joints", _joints(log, list(machine.joint_names))),
        _topic("/events", _events(log, graph)),
        _topic("/diagnostics", [(t, diagnostic_array(STORE, said)) for t, said in graph.diagnostics]),
        *_targets(log),
    ]


def _topic(name: str, messages: list[tuple[int, "Msg"]]) -> RecordedTopic:
    return RecordedTopic(name, TOPICS[name], messages)


def _targets(log: RawLog) -> list[RecordedTopic]:
    if log.targets is None:
        return []
    time_ns, position, quaternion = map(
        as_array, (log.targets.log_time_ns, log.targets.position, log.targets.quaternion)
    )
    poses, marks = [], []
    for t, p, w in zip(time_ns.tolist(), position, quaternion, strict=True):
        pose = typed("geometry_msgs/msg/Pose")(position=vector("Point", p), orientation=quaternion_message(w))
        poses.append((t, typed("geometry_msgs/msg/PoseStamped")(header=header(t), pose=pose)))
        marks.append((t, cloud(pose_mark(p, w), t)))
    return [_topic("/target", poses), _topic("/target_mark", marks)]


def pose_mark(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """A cross at the tip's position (3,) with a line along the chisel, in {B}, m, (n, 3)."""
    line = np.arange(-TARGET_ARM_M, TARGET_ARM_M + POINT_SPACING_M / 2, POINT_SPACING_M)
    chisel = np.arange(0.0, TARGET_CHISEL_M, POINT_SPACING_M)
    zero, none = np.zeros_like(line), np.zeros_like(chisel)
    mark = np.concatenate(
        [
            np.stack([line, zero, zero], axis=1),
            np.stack([zero, line, zero], axis=1),
            np.stack([none, none, chisel], axis=1),  # the chisel points along -z: its body is above the tip
        ]
    )
    return position + _rotated(quaternion, mark)


def _events(log: RawLog, graph: GraphRecord) -> list[tuple[int, "Msg"]]:
    """Targets, ends of goals, emergency stops and their resets, as lines of a log."""
    lines: list[tuple[int, int, str, str]] = []
    if log.targets is not None:
        for t, p in zip(
            as_array(log.targets.log_time_ns).tolist(), as_array(log.targets.position), strict=True
        ):
            lines.append(
                (t, LEVEL_INFORMATION, "autonomous_server", f"target at {np.round(p, 3).tolist()} m")
            )
    for t, result in graph.results:
        text = f"goal {result.goal_id}: {result.outcome} after {result.n_ticks} ticks"
        lines.append((t, LEVEL_INFORMATION, "autonomous_server", text))
    for t, stop in graph.stops:
        lines.append((t, LEVEL_ERROR, "control_supervisor", f"stopped by {stop.rule}: {stop.detail}"))
    for t, _ in graph.resets:
        lines.append((t, LEVEL_INFORMATION, "operator", "the stop was acknowledged"))
    for t, _ in graph.releases:
        lines.append((t, LEVEL_INFORMATION, "control_supervisor", "the stop was reset"))
    make = typed("rcl_interfaces/msg/Log")
    return [
        (t, make(stamp=stamp(t), level=level, name=name, msg=text, file="", function="", line=0))
        for t, level, name, text in sorted(lines, key=lambda line: line[0])
    ]


def _joints(log: RawLog, names: Sequence[str]) -> list[tuple[int, "Msg"]]:
    """Positions, their rates of change between messages as velocities, and the commands in force as efforts."""
    time_ns, q = as_array(log.joint_log_time_ns), as_array(log.q)
    command_ns, command = as_array(log.command_log_time_ns), as_array(log.command)
    newest = np.searchsorted(command_ns, time_ns, side="right") - 1
    in_force = np.zeros_like(q)
    in_force[newest >= 0] = command[newest[newest >= 0]]
    step_s = np.maximum(np.diff(time_ns), 1)[:, None] / NANOSECONDS
    velocity = np.concatenate([np.zeros_like(q[:1]), np.diff(q, axis=0) / step_s])
    make = typed("sensor_msgs/msg/JointState")
    # a log's columns may be strided in memory, and a message's array must be contiguous
    values = (np.ascontiguousarray(columns, float) for columns in (q, velocity, in_force))
    return [
        (t, make(header=header(t), name=list(names), position=p, velocity=v, effort=a))
        for t, p, v, a in zip(time_ns.tolist(), *values, strict=True)
    ]


def _frames(joints: Sequence[JointTransforms], row: int, time_ns: int) -> "Msg":
    transform, stamped = typed("geometry_msgs/msg/Transform"), typed("geometry_msgs/msg/TransformStamped")
    return typed("tf2_msgs/msg/TFMessage")(
        transforms=[
            stamped(
                header=header(time_ns, joint.parent),
                child_frame_id=joint.child,
                transform=transform(
                    translation=vector("Vector3", joint.position[row]),
                    rotation=quaternion_message(joint.quaternion[row]),
                ),
            )
            for joint in joints
        ]
    )


def _polylines(lines: Sequence[np.ndarray]) -> np.ndarray:
    """Points along polylines, (n, 3), m."""
    found = []
    for line in lines:
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        at = np.arange(0.0, length[-1], POINT_SPACING_M)
        found.append(np.stack([np.interp(at, length, axis) for axis in line.T], axis=1))
    return np.concatenate(found)


def _rotated(quaternion: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points, (n, 3), turned by a quaternion (w, x, y, z) of any length but zero."""
    w, v = quaternion[0], quaternion[1:]
    cross = np.cross(v, points)
    turned: np.ndarray = points + 2.0 * (w * cross + np.cross(v, cross)) / (quaternion @ quaternion)
    return turned
