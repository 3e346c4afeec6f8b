"""The operator at the real graph: gives targets one after the other, waits for how each ended, and records."""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from pipeline.deployment.messages import ReachGoal, ReachResult, Topic
from pipeline.deployment.recording import Recorder
from pipeline.deployment.ros1.installation import require_ros
from pipeline.deployment.ros1.message_types import carriers
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

POLL_S = 0.1
RECORDED = (Topic.joint_states, Topic.joint_commands, Topic.target_pose)


class Operator:
    """A node that talks to `autonomous_server`; needs the graph's master in the environment.

    Attributes:
        recorder: what was heard on the topics that logs hold.
    """

    def __init__(self, machine: MachineSpecification, clock_offset_ns: int) -> None:
        """Joins the graph, whose time is the monotonic clock plus `clock_offset_ns`."""
        rospy = require_ros()
        self._carriers = carriers(machine)
        self._results: queue.Queue[ReachResult] = queue.Queue()
        self._offset_ns = clock_offset_ns
        self._lock = threading.Lock()
        self.recorder = Recorder()
        rospy.init_node("operator", disable_signals=True)
        goal, result = self._carriers[Topic.goal], self._carriers[Topic.result]
        self._goals = rospy.Publisher(goal.name, goal.ros_type, queue_size=10)
        rospy.Subscriber(result.name, result.ros_type, self._take)
        for topic in RECORDED:
            carrier = self._carriers[topic]
            rospy.Subscriber(
                carrier.name, carrier.ros_type, self._record, callback_args=topic, tcp_nodelay=True
            )

    def _take(self, ros_message: Any) -> None:
        result = self._carriers[Topic.result].from_ros(ros_message, 0)
        if isinstance(result, ReachResult):
            self._results.put(result)

    def _record(self, ros_message: Any, topic: Topic) -> None:
        now_ns = time.monotonic_ns() + self._offset_ns
        with self._lock:
            self.recorder(topic, self._carriers[topic].from_ros(ros_message, now_ns), now_ns)

    def wait_for_server(self, timeout_s: float, is_running: Callable[[], bool]) -> None:
        """Wait until the server hears goals.

        Raises:
            InputError: it does not in time, or a node has ended.
        """
        deadline = time.monotonic() + timeout_s
        while self._goals.get_num_connections() == 0:
            if time.monotonic() > deadline or not is_running():
                raise InputError(
                    f"autonomous_server did not come up within {timeout_s:g} s; see the nodes' logs"
                )
            time.sleep(POLL_S)

    def pursue(self, goals: Sequence[ReachGoal], timeout_s: float) -> list[ReachResult]:
        """Give each goal when the one before has ended.

        Raises:
            InputError: a goal did not end in time.
        """
        results = []
        for goal in goals:
            self._goals.publish(self._carriers[Topic.goal].to_ros(goal))
            try:
                results.append(self._results.get(timeout=timeout_s))
            except queue.Empty:
                raise InputError(f"goal {goal.goal_id} did not end within {timeout_s:g} s") from None
        return results
