"""A node of the real graph that records messages, from which a bag is written."""

import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.messages import MachineOutputs, Message, Topic
from pipeline.deployment.transports.ros1.clock import GraphClock
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.deployment.transports.simulated_time.graph import Tap
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

POLL_S = 0.1
RECORDED = (
    Topic.joint_states,
    Topic.joint_commands,
    Topic.target_pose,
    Topic.requested_commands,
    Topic.emergency_stop,
    Topic.reset,
    Topic.release,
    Topic.diagnostics,
    Topic.machine_outputs,
)


class Listener:
    """Records the graph; needs the graph's master in the environment.

    Attributes:
        recorder: messages on the topics of logs, and emergency stops.
        outputs: valve outputs of the simulated PLC, if there is one.
    """

    def __init__(self, machine: MachineSpecification, name: str, taps: Sequence[Tap] = ()) -> None:
        """Joins the graph.

        Args:
            machine: names its topics.
            name: name of this node.
            taps: called with topic, message and time of every message.

        Raises:
            InputError: ROS 1 is not installed, or the graph has no clock.
        """
        rospy = require_ros()
        self._carriers = carriers(machine)
        self._lock = threading.Lock()
        self.recorder = Recorder()
        self._taps: list[Tap] = [self.recorder, *taps]
        remappings = [word for word in sys.orig_argv if ":=" in word]
        rospy.init_node(name, argv=remappings, disable_signals=True)
        self._clock = GraphClock(rospy)
        self.outputs: list[MachineOutputs] = []
        self._subscribers = []
        for topic in RECORDED:
            carrier = self._carriers[topic]
            self._subscribers.append(
                rospy.Subscriber(
                    carrier.name, carrier.ros_type, self._record, callback_args=topic, tcp_nodelay=True
                )
            )

    def _record(self, ros_message: Any, topic: Topic) -> None:
        now_ns = self._clock.now_ns()
        message = self._carriers[topic].from_ros(ros_message, now_ns)
        self._keep(topic, message, now_ns)

    def _keep(self, topic: Topic, message: Message, now_ns: int) -> None:
        with self._lock:
            if isinstance(message, MachineOutputs):
                self.outputs.append(message)
            for tap in self._taps:
                tap(topic, message, now_ns)

    def now_ns(self) -> int:
        """Time of the graph."""
        return self._clock.now_ns()

    def wait_for_nodes(self, n_nodes: int, timeout_s: float, require_running: Callable[[], None]) -> None:
        """Wait until `n_nodes` nodes are connected, each of which announces every topic.

        Raises:
            InputError: they are not connected in time, or a node has ended.
        """

        def are_connected() -> bool:
            return min(subscriber.get_num_connections() for subscriber in self._subscribers) >= n_nodes

        wait_until_up(are_connected, f"{n_nodes} nodes", timeout_s, require_running)

    def listen(self, duration_s: float, require_running: Callable[[], None]) -> None:
        """Listen for a duration; later messages reach neither recorder nor taps.

        Raises:
            InputError: a node has ended.
        """
        deadline = time.monotonic() + duration_s
        try:
            while (left_s := deadline - time.monotonic()) > 0:
                require_running()
                time.sleep(min(POLL_S, left_s))
        finally:
            with self._lock:  # held while a message is stored, so that storing is complete
                self._taps.clear()


def wait_until_up(
    is_up: Callable[[], bool], what: str, timeout_s: float, require_running: Callable[[], None]
) -> None:
    """Wait for a part of the graph to start.

    Args:
        is_up: whether it has started.
        what: its name, for the message.
        timeout_s: how long to wait.
        require_running: raises if a node has ended.

    Raises:
        InputError: it does not start in time, or a node has ended.
    """
    deadline = time.monotonic() + timeout_s
    while not is_up():
        require_running()
        if time.monotonic() > deadline:
            raise InputError(f"{what} did not come up within {timeout_s:g} s; see the nodes' logs")
        time.sleep(POLL_S)
