"""A component as a ROS 1 node: rospy's threads bring messages, one thread ticks, one carries computations out.

The node's clock is the host's monotonic clock, set once for the whole graph when it is launched: a step of the wall
clock moves nothing.
"""

import json
import queue
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.atomic_files import write_whole
from pipeline.deployment.component import (
    NANOSECONDS,
    Component,
    Computation,
    ComputingComponent,
    Output,
    Publication,
)
from pipeline.deployment.messages import JointCommand, JointState, Topic
from pipeline.deployment.ros1.installation import require_ros
from pipeline.deployment.ros1.message_types import carriers
from pipeline.machine.specification import MachineSpecification

QUEUE = 100


class Node:
    """Runs one component until the graph is shut down, and measures what it sees of the graph.

    Attributes:
        measured: seconds, by name: `age <topic>` of messages that arrive, `timer` lateness of ticks, `tick` from
            waking up to the last message sent, `computation`; and `missed`, ticks whose turn came too late.
    """

    def __init__(self, component: Component, machine: MachineSpecification, clock_offset_ns: int) -> None:
        """Starts the node; `clock_offset_ns` added to the monotonic clock is the graph's time.

        Raises:
            InputError: ROS 1 is not installed.
        """
        self._rospy = require_ros()
        self._component = component
        self._offset_ns = clock_offset_ns
        self._lock = threading.Lock()
        self._computations: queue.Queue[Any] = queue.Queue()
        self.measured: dict[str, list[float]] = {}
        self._rospy.init_node(component.name, disable_signals=False)
        self._carriers = carriers(machine)
        self._publishers = {
            topic: self._rospy.Publisher(c.name, c.ros_type, queue_size=QUEUE, tcp_nodelay=True)
            for topic, c in self._carriers.items()
        }
        for topic in component.subscriptions:
            if topic in self._carriers:
                carrier = self._carriers[topic]
                self._rospy.Subscriber(
                    carrier.name,
                    carrier.ros_type,
                    self._receive,
                    callback_args=topic,
                    queue_size=QUEUE,
                    tcp_nodelay=True,
                )

    def now_ns(self) -> int:
        """Time of the graph."""
        return time.monotonic_ns() + self._offset_ns

    def spin(self) -> None:
        """Run until the graph is shut down."""
        if isinstance(component := self._component, ComputingComponent):
            threading.Thread(target=self._compute, args=(component,), daemon=True).start()
        period_ns = self._component.period_ns
        if period_ns is None:
            self._rospy.spin()
            return
        due_ns = self.now_ns() + period_ns
        while not self._rospy.is_shutdown():
            wait_ns = due_ns - self.now_ns()
            if wait_ns > 0:
                time.sleep(wait_ns / NANOSECONDS)
            woken_ns = self.now_ns()
            with self._lock:
                self._carry_out(self._component.on_timer(woken_ns))
            self._measure("timer", woken_ns - due_ns)
            self._measure("tick", self.now_ns() - woken_ns)
            due_ns += period_ns
            while due_ns + period_ns < self.now_ns():  # too late for a whole tick: counted, not made up for
                self._measure("missed", self.now_ns() - due_ns)
                due_ns += period_ns

    def save(self, path: Path) -> None:
        """Write what was measured, as JSON."""
        write_whole(path, (json.dumps(self.measured) + "\n").encode())

    def _receive(self, ros_message: Any, topic: Topic) -> None:
        now_ns = self.now_ns()
        message = self._carriers[topic].from_ros(ros_message, now_ns)
        if isinstance(message, JointCommand | JointState):
            self._measure(f"age {topic}", now_ns - message.stamp_ns)
        with self._lock:
            self._carry_out(self._component.on_message(topic, message, self.now_ns()))

    def _carry_out(self, outputs: Sequence[Output]) -> None:
        for output in outputs:
            if isinstance(output, Computation):
                self._computations.put((self.now_ns(), output.request))
            elif isinstance(output, Publication):
                self._publishers[output.topic].publish(self._carriers[output.topic].to_ros(output.message))

    def _compute(self, component: ComputingComponent) -> None:
        while True:
            begun_ns, request = self._computations.get()
            result = component.compute(request)
            with self._lock:
                self._carry_out(component.on_computed(result, self.now_ns()))
            self._measure(f"computation {type(request).__name__}", self.now_ns() - begun_ns)

    def _measure(self, name: str, nanoseconds: int) -> None:
        self.measured.setdefault(name, []).append(nanoseconds / NANOSECONDS)
