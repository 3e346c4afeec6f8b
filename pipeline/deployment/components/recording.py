"""A recorder in the graph, which can write a bag."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.deployment.graph_logs.graph_topics import GraphRecord, add_graph_topics
from pipeline.deployment.messages import (
    Diagnostics,
    EmergencyStop,
    JointCommand,
    JointState,
    MachineCommand,
    Message,
    ReachResult,
    Release,
    Reset,
    TargetPose,
    Topic,
)
from pipeline.logs.formats.writer import write_bag
from pipeline.logs.messages.raw_log import TargetPoses
from pipeline.machine.specification import MachineSpecification

BASE_FRAME = "base_link"


@dataclass
class Recorder:
    """A tap of the graph that stores messages with their times of publication, ns."""

    states: list[tuple[int, JointState]] = field(default_factory=list)
    commands: list[tuple[int, MachineCommand]] = field(default_factory=list)
    targets: list[tuple[int, TargetPose]] = field(default_factory=list)
    requests: list[tuple[int, JointCommand]] = field(default_factory=list)
    results: list[ReachResult] = field(default_factory=list)
    stops: list[EmergencyStop] = field(default_factory=list)
    releases: list[Release] = field(default_factory=list)
    resets: list[Reset] = field(default_factory=list)
    diagnostics: list[Diagnostics] = field(default_factory=list)

    def __call__(self, topic: Topic, message: Message, time_ns: int) -> None:
        """Store a message."""
        if isinstance(message, JointState):
            self.states.append((time_ns, message))
        elif isinstance(message, MachineCommand):
            self.commands.append((time_ns, message))
        elif isinstance(message, JointCommand):
            self.requests.append((time_ns, message))
        elif isinstance(message, TargetPose):
            self.targets.append((time_ns, message))
        elif isinstance(message, ReachResult):
            self.results.append(message)
        elif isinstance(message, EmergencyStop):
            self.stops.append(message)
        elif isinstance(message, Release):
            self.releases.append(message)
        elif isinstance(message, Reset):
            self.resets.append(message)
        elif isinstance(message, Diagnostics):
            self.diagnostics.append(message)

    def graph_record(self) -> GraphRecord:
        """What the graph said of itself, by the times of sending but for requests."""
        return GraphRecord(
            self.requests,
            [(result.stamp_ns, result) for result in self.results],
            [(stop.stamp_ns, stop) for stop in self.stops],
            [(release.stamp_ns, release) for release in self.releases],
            [(reset.stamp_ns, reset) for reset in self.resets],
            [(told.stamp_ns, told) for told in self.diagnostics],
        )

    def target_poses(self) -> TargetPoses:
        """The targets in the form of logs."""
        return TargetPoses(
            log_time_ns=np.array([time_ns for time_ns, _ in self.targets], np.int64),
            position=np.array([target.position for _, target in self.targets], np.float64).reshape(-1, 3),
            quaternion=np.array([target.quaternion for _, target in self.targets], np.float64).reshape(-1, 4),
            frame_id=BASE_FRAME,
        )

    def write(self, path: Path, machine: MachineSpecification) -> None:
        """Write a bag as the machine's recorder does, and the graph's own topics into a second file.

        The recorder must hold joint states and commands.

        Raises:
            InputError: the folder exists.
        """
        write_bag(
            path,
            machine,
            joint_state_header_stamp_ns=np.array([state.stamp_ns for _, state in self.states], np.int64),
            joint_state_log_time_ns=np.array([time_ns for time_ns, _ in self.states], np.int64),
            joint_names=machine.joint_names,
            positions=np.array([state.position for _, state in self.states], np.float64),
            velocities=np.array([state.velocity for _, state in self.states], np.float64),
            command_log_time_ns=np.array([time_ns for time_ns, _ in self.commands], np.int64),
            commands=np.array([command.values for _, command in self.commands], np.float64),
            target_poses=self.target_poses() if self.targets else None,
        )
        record = self.graph_record()
        if any(record):
            add_graph_topics(path, record)
