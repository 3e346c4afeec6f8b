"""The action `autonomous_server/reach`: any actionlib client can give a target pose as a goal.

One goal is pursued at a time; a new one preempts it.
"""

import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.deployment.components.recording import BASE_FRAME
from pipeline.deployment.messages import (
    CancelGoal,
    GoalOutcome,
    JointState,
    Message,
    ReachGoal,
    ReachResult,
    TargetPose,
    Topic,
)
from pipeline.deployment.transports.ros1.definitions import PACKAGE, own_types
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.message_types import fill_pose, read_pose, ros_time

ACTION = "autonomous_server/reach"
GoalErrors = Callable[
    [np.ndarray, ReachGoal], tuple[float, float]
]  # of q (n_joint,): distance, m; pitch, rad


class _Pursuit:
    """The component's goal: its handle, its message, and whether the client cancelled it."""

    def __init__(self, handle: Any, message: ReachGoal) -> None:
        self.handle = handle
        self.message = message
        self.is_cancelled = False


class ReachActionServer:
    """Translates between actionlib and a component that receives `ReachGoal` and `CancelGoal`.

    The component gets a goal only after it has answered the previous one, by a target pose (accepted) or a result
    (refused). Meanwhile the newest goal waits, and an older waiting one is recalled. A goal that is cancelled before
    the component's answer is given up after the answer.

    actionlib calls back while it holds its own lock. A separate thread takes the calls over, so that the node's lock
    is always the outer one.
    """

    def __init__(
        self, lock: threading.RLock, deliver: Callable[[Topic, Message], None], errors: GoalErrors | None
    ) -> None:
        """Advertises the action.

        Args:
            lock: lock of the node; it is held during calls of the component.
            deliver: passes a message to the component.
            errors: errors of a joint state for feedback; None disables feedback.
        """
        require_ros()
        import actionlib

        self._types = own_types()
        self._lock = lock
        self._deliver = deliver
        self._errors = errors
        self._calls: queue.Queue[tuple[Callable[[Any], None], Any]] = queue.Queue()
        self._n_goals = 0
        self._waiting: Any = None
        self._asked: _Pursuit | None = None
        self._in_hand: _Pursuit | None = None
        self._server = actionlib.ActionServer(
            ACTION,
            self._types[f"{PACKAGE}/ReachAction"],
            lambda handle: self._calls.put((self._take, handle)),
            lambda handle: self._calls.put((self._cancel, handle)),
            auto_start=False,
        )
        self._server.start()

    def published(self, message: Message) -> None:
        """Process the component's target pose or result; the node's lock is held."""
        if isinstance(message, TargetPose) and self._asked is not None:
            self._in_hand, self._asked = self._asked, None
            self._in_hand.handle.set_accepted()
            if self._in_hand.is_cancelled:
                self._deliver(Topic.cancel, CancelGoal(self._in_hand.message.goal_id))
        elif isinstance(message, ReachResult):
            self._end(message)
        if self._asked is None and self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._ask(waiting)

    def feed_back(self, state: JointState) -> None:
        """Send the distance to the goal as feedback; the node's lock is not held."""
        pursuit = self._in_hand
        if pursuit is None or self._errors is None:
            return
        distance_m, pitch_rad = self._errors(state.position, pursuit.message)
        feedback = self._types[f"{PACKAGE}/ReachFeedback"]
        pursuit.handle.publish_feedback(feedback(ros_time(state.stamp_ns), distance_m, pitch_rad))

    def work(self) -> None:
        """Forward the clients' goals and cancellations without end, in a separate thread."""
        while True:
            call, handle = self._calls.get()
            with self._lock:
                call(handle)

    def _take(self, handle: Any) -> None:
        frame = handle.get_goal().target.header.frame_id
        if frame not in ("", BASE_FRAME):
            handle.set_rejected(text=f"the target is in frame {frame}; give it in {BASE_FRAME}")
        elif self._asked is None:
            self._ask(handle)
        else:
            if self._waiting is not None:
                self._waiting.set_canceled(text="a newer goal came")
            self._waiting = handle

    def _ask(self, handle: Any) -> None:
        self._n_goals += 1
        self._asked = _Pursuit(handle, ReachGoal(self._n_goals, *read_pose(handle.get_goal().target)))
        self._deliver(Topic.goal, self._asked.message)

    def _cancel(self, handle: Any) -> None:
        # actionlib's handles can be compared with handles only
        if self._waiting is not None and self._waiting == handle:
            self._waiting = None
            handle.set_canceled(text="cancelled")
        elif self._asked is not None and self._asked.handle == handle:
            self._asked.is_cancelled = True
        elif self._in_hand is not None and self._in_hand.handle == handle:
            self._deliver(Topic.cancel, CancelGoal(self._in_hand.message.goal_id))

    def _end(self, message: ReachResult) -> None:
        result = self._types[f"{PACKAGE}/ReachResult"](
            ros_time(message.stamp_ns), message.outcome.value, message.n_ticks
        )
        if self._in_hand is not None and self._in_hand.message.goal_id == message.goal_id:
            handle, self._in_hand = self._in_hand.handle, None
            if message.outcome is GoalOutcome.reached:
                handle.set_succeeded(result, message.outcome)
            elif message.outcome is GoalOutcome.cancelled:
                handle.set_canceled(result, message.outcome)
            else:
                handle.set_aborted(result, message.outcome)
        elif self._asked is not None and self._asked.message.goal_id == message.goal_id:
            handle, self._asked = self._asked.handle, None
            handle.set_rejected(result, message.outcome)


class ReachClient:
    """An actionlib client that gives one goal at a time; any other client works, too."""

    def __init__(self) -> None:
        """Joins the action; the process must be a node."""
        self._rospy = require_ros()
        import actionlib

        self._types = own_types()
        self._client = actionlib.SimpleActionClient(ACTION, self._types[f"{PACKAGE}/ReachAction"])
        self._goal_id = 0
        self.feedback: list[tuple[float, float]] = []

    def is_connected(self, timeout_s: float) -> bool:
        """Whether the server answers within the time."""
        return bool(self._client.wait_for_server(self._rospy.Duration(timeout_s)))

    def give(self, goal: ReachGoal) -> None:
        """Give a goal; `feedback` collects its distance, m, and error in pitch, rad."""
        self._goal_id = goal.goal_id
        self.feedback = []
        ros_goal = self._types[f"{PACKAGE}/ReachGoal"]()
        fill_pose(ros_goal.target, 0, goal.position, goal.quaternion)
        # actionlib drops what a quick server answers before `send_goal` has returned; its threads wait here instead.
        with self._client.action_client.manager.list_mutex:
            self._client.send_goal(
                ros_goal, feedback_cb=lambda ros: self.feedback.append((ros.position_error, ros.pitch_error))
            )

    def cancel(self) -> None:
        """Cancel the goal; its result follows."""
        self._client.cancel_goal()

    def result(self, timeout_s: float) -> ReachResult | None:
        """The goal's result; None after the time-out or if the server is gone."""
        if not self._client.wait_for_result(self._rospy.Duration(timeout_s)):
            return None
        ros = self._client.get_result()
        if ros is None or not ros.outcome:
            return None
        return ReachResult(ros.stamp.to_nsec(), self._goal_id, GoalOutcome(ros.outcome), ros.n_ticks)
