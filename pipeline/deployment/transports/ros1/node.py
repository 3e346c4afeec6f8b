"""A component as a ROS 1 node: rospy's threads deliver messages, one thread ticks, one executes computations."""

import json
import queue
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.deployment.component import (
    NANOSECONDS,
    Component,
    Computation,
    ComputingComponent,
    Output,
    Publication,
)
from pipeline.deployment.diagnostics import PERIOD_NS, DiagnosticReporter
from pipeline.deployment.messages import JointCommand, JointState, Message, Topic
from pipeline.deployment.transports.ros1.clock import GraphClock
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.deployment.transports.ros1.reach_action import GoalErrors, ReachActionServer
from pipeline.files.atomic import write_whole
from pipeline.machine.specification import MachineSpecification

QUEUE = 100


class Node:
    """Runs one component until the graph is shut down, and measures delays.

    An exception in any thread ends the node, so that the others miss it.

    Attributes:
        measured: seconds, by name: `age <topic>` of arriving messages, `timer` lateness of ticks, `tick` from waking
            up to the last message sent, `computation`; and `missed`, ticks that came too late.
    """

    def __init__(
        self, component: Component, machine: MachineSpecification, errors: GoalErrors | None = None
    ) -> None:
        """Starts the node; needs the graph's master in the environment.

        Args:
            component: the component; one that receives goals is the server of the action `reach`.
            machine: names its topics.
            errors: errors for the action's feedback.

        Raises:
            InputError: ROS 1 is not installed, or the graph has no clock.
        """
        self._rospy = require_ros()
        self._component = component
        self._lock = threading.RLock()
        self._computations: queue.Queue[Any] = queue.Queue()
        self.measured: dict[str, list[float]] = {}
        remappings = [
            word for word in sys.orig_argv if ":=" in word
        ]  # roslaunch's arguments, which a stage removes
        self._rospy.init_node(component.name, argv=remappings, disable_signals=False)
        self._clock = GraphClock(self._rospy)
        self._reporter = DiagnosticReporter(component, self.now_ns())
        self._carriers = carriers(machine)
        self._publishers = {
            topic: self._rospy.Publisher(c.name, c.ros_type, queue_size=QUEUE, tcp_nodelay=True)
            for topic, c in self._carriers.items()
        }
        self._failure: Exception | None = None
        self._state: JointState | None = None
        self._action: ReachActionServer | None = None
        if Topic.goal in component.subscriptions:
            self._action = ReachActionServer(self._lock, self._deliver, errors)
        for topic in component.subscriptions:
            if topic in self._carriers:
                carrier = self._carriers[topic]
                self._rospy.Subscriber(
                    carrier.name,
                    carrier.ros_type,
                    self._hear,
                    callback_args=topic,
                    queue_size=QUEUE,
                    tcp_nodelay=True,
                )

    def now_ns(self) -> int:
        """Time of the graph."""
        return self._clock.now_ns()

    def spin(self) -> None:
        """Run until the graph is shut down.

        Raises:
            Exception: the component's exception.
        """
        if isinstance(component := self._component, ComputingComponent):
            self._start_thread(self._compute, component)
        if self._action is not None:
            self._start_thread(self._action.work)
        self._start_thread(self._report)
        if self._component.period_ns is None:
            self._rospy.spin()
        else:
            self._guard(self._tick, self._component.period_ns)
        if self._failure is not None:
            raise self._failure

    def _tick(self, period_ns: int) -> None:
        due_ns = self.now_ns() + period_ns
        while not self._rospy.is_shutdown():
            wait_ns = due_ns - self.now_ns()
            if wait_ns > 0:
                time.sleep(wait_ns / NANOSECONDS)
            woken_ns = self.now_ns()
            if self._rospy.is_shutdown():
                break  # a tick delayed by the shutdown does not count as missed
            with self._lock:
                self._reporter.ticked()
                self._carry_out(self._component.on_timer(woken_ns))
            self._measure("timer", woken_ns - due_ns)
            self._measure("tick", self.now_ns() - woken_ns)
            if self._action is not None and self._state is not None:
                self._action.feed_back(self._state)
            due_ns += period_ns
            while due_ns + period_ns < self.now_ns():  # late by a whole tick: counted, not repeated
                self._measure("missed", self.now_ns() - due_ns)
                due_ns += period_ns

    def _report(self) -> None:
        while not self._rospy.is_shutdown():
            time.sleep(PERIOD_NS / NANOSECONDS)
            with self._lock:
                self._carry_out([self._reporter.report(self.now_ns())])

    def save(self, path: Path) -> None:
        """Write the measurements as JSON."""
        write_whole(path, (json.dumps(self.measured) + "\n").encode())

    def _start_thread(self, function: Callable[..., None], *arguments: Any) -> None:
        threading.Thread(target=self._guard, args=(function, *arguments), daemon=True).start()

    def _guard(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call and store exceptions; rospy would log them and go on.

        A shutdown closes rospy's topics first and is told by `is_shutdown` last, in the midst of whatever is being
        sent. What fails once it was asked for is no failure of the component.
        """
        try:
            function(*arguments)
        except Exception as failure:
            if not self._rospy.core.is_shutdown_requested():
                self._failure = failure
                self._rospy.signal_shutdown(repr(failure))

    def _hear(self, ros_message: Any, topic: Topic) -> None:
        self._guard(self._receive, ros_message, topic)

    def _receive(self, ros_message: Any, topic: Topic) -> None:
        now_ns = self.now_ns()
        message = self._carriers[topic].from_ros(ros_message, now_ns)
        if isinstance(message, JointCommand | JointState):
            self._measure(f"age {topic}", now_ns - message.stamp_ns)
        if isinstance(message, JointState):
            self._state = message
        self._deliver(topic, message)

    def _deliver(self, topic: Topic, message: Message) -> None:
        with self._lock:
            self._reporter.received(topic)
            self._carry_out(self._component.on_message(topic, message, self.now_ns()))

    def _carry_out(self, outputs: Sequence[Output]) -> None:
        for output in outputs:
            if isinstance(output, Computation):
                self._computations.put((self.now_ns(), output.request))
                continue
            assert isinstance(output, Publication)
            self._reporter.sent(output.topic)
            if output.topic in self._carriers:
                self._publishers[output.topic].publish(self._carriers[output.topic].to_ros(output.message))
            if self._action is not None:
                self._action.published(output.message)

    def _compute(self, component: ComputingComponent) -> None:
        while True:
            begun_ns, request = self._computations.get()
            result = component.compute(request)
            with self._lock:
                self._carry_out(component.on_computed(result, self.now_ns()))
            self._measure(f"computation {type(request).__name__}", self.now_ns() - begun_ns)

    def _measure(self, name: str, nanoseconds: int) -> None:
        self.measured.setdefault(name, []).append(nanoseconds / NANOSECONDS)
