"""The operator of the real graph: gives targets one after the other, waits for each result, and records."""

from collections.abc import Callable, Sequence

from pipeline.deployment.messages import ReachGoal, ReachResult, Topic
from pipeline.deployment.transports.ros1.listener import POLL_S, Listener, wait_until_up
from pipeline.deployment.transports.ros1.reach_action import ReachClient
from pipeline.deployment.transports.simulated_time.graph import Tap
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification


class Operator(Listener):
    """A node that sends goals to `autonomous_server`, and records.

    Attributes:
        client: client of the action.
    """

    def __init__(self, machine: MachineSpecification, taps: Sequence[Tap] = ()) -> None:
        """Joins the graph; see `Listener` for the arguments.

        Raises:
            InputError: ROS 1 is not installed, or the graph has no clock.
        """
        super().__init__(machine, "operator", taps)
        self.client = ReachClient()

    def wait_for_server(self, timeout_s: float, require_running: Callable[[], None]) -> None:
        """Wait until the server accepts goals.

        Raises:
            InputError: it does not start in time, or a node has ended.
        """
        wait_until_up(
            lambda: self.client.is_connected(POLL_S), "autonomous_server", timeout_s, require_running
        )

    def pursue(self, goals: Sequence[ReachGoal], timeout_s: float) -> list[ReachResult]:
        """Give each goal after the end of the previous one.

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
        """Wait for the goal's result.

        Raises:
            InputError: the goal did not end in time, or the server is gone.
        """
        result = self.client.result(timeout_s)
        if result is None:
            raise InputError(f"a goal did not end within {timeout_s:g} s; see the nodes' logs")
        self._keep(Topic.result, result, self.now_ns())
        return result
