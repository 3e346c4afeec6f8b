"""The operator at the real graph: gives targets one after the other, waits for how each ended, and records."""

import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from pipeline.deployment.messages import MachineOutputs, ReachGoal, ReachResult, Topic
from pipeline.deployment.recording import Recorder
from pipeline.deployment.ros1.clock import GraphClock
from pipeline.deployment.ros1.installation import require_ros
from pipeline.deployment.ros1.message_types import carriers
from pipeline.deployment.ros1.reach_action import ReachClient
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

POLL_S = 0.1
RECORDED = (
    Topic.joint_states,
    Topic.joint_commands,
    Topic.target_pose,
    Topic.requested_commands,
    Topic.emergency_stop,
    Topic.machine_outputs,
)


class Operator:
    """A node that talks to `autonomous_server`; needs the graph's master in the environment.

    Attributes:
        recorder: what was heard on the topics that logs hold, and emergency stops.
        outputs: what the simulated PLC, if there is one, set its valves to.
        client: of the action.
    """

    def __init__(self, machine: MachineSpecification) -> None:
        """Joins the graph.

        Raises:
            InputError: ROS 1 is not installed, or the graph has no clock.
        """
        rospy = require_ros()
        self._carriers = carriers(machine)
        self._lock = threading.Lock()
        self.recorder = Recorder()
        remappings = [word for word in sys.orig_argv if ":=" in word]
        rospy.init_node("operator", argv=remappings, disable_signals=True)
        self._clock = GraphClock(rospy)
        self.client = ReachClient()
        self.outputs: list[MachineOutputs] = []
        for topic in RECORDED:
            carrier = self._carriers[topic]
            rospy.Subscriber(
                carrier.name, carrier.ros_type, self._record, callback_args=topic, tcp_nodelay=True
            )

    def _record(self, ros_message: Any, topic: Topic) -> None:
        now_ns = self._clock.now_ns()
        message = self._carriers[topic].from_ros(ros_message, now_ns)
        with self._lock:
            if isinstance(message, MachineOutputs):
                self.outputs.append(message)
            self.recorder(topic, message, now_ns)

    def now_ns(self) -> int:
        """Time of the graph."""
        return self._clock.now_ns()

    def wait_for_server(self, timeout_s: float, is_running: Callable[[], bool]) -> None:
        """Wait until the server hears goals.

        Raises:
            InputError: it does not in time, or a node has ended.
        """
        deadline = time.monotonic() + timeout_s
        while not self.client.is_connected(POLL_S):
            if time.monotonic() > deadline or not is_running():
                raise InputError(
                    f"autonomous_server did not come up within {timeout_s:g} s; see the nodes' logs"
                )

    def pursue(self, goals: Sequence[ReachGoal], timeout_s: float) -> list[ReachResult]:
        """Give each goal when the one before has ended.

        Raises:
            InputError: a goal did not end in time.
        """
        results = []
        for goal in goals:
            self.give(goal)
            results.append(self.result(timeout_s))
        return results

    def give(self, goal: ReachGoal) -> None:
        """Give a goal."""
        self.client.give(goal)

    def result(self, timeout_s: float) -> ReachResult:
        """Wait for how the goal ended.

        Raises:
            InputError: it did not in time, or the server is gone.
        """
        result = self.client.result(timeout_s)
        if result is None:
            raise InputError(f"a goal did not end within {timeout_s:g} s; see the nodes' logs")
        self.recorder.results.append(result)
        return result
