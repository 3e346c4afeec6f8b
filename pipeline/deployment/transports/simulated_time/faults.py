"""The interface of faults in the simulated graph."""

from collections.abc import Sequence

from pipeline.deployment.messages import Message, Topic


class Fault:
    """Base of all faults, without any fault. Times are the simulation's, ns."""

    def deliver(
        self, topic: Topic, target: str, message: Message, time_ns: int
    ) -> Sequence[tuple[int, Message]] | None:
        """Replacement of a message that is due now: extra delays, ns, and messages; None keeps it."""
        return None

    def is_running(self, component: str, time_ns: int) -> bool:
        """Whether a component receives messages and ticks."""
        return True

    def clock_error_ns(self, component: str, time_ns: int) -> int:
        """Lead of the component's clock."""
        return 0

    def extra_computation_ns(self, component: str, time_ns: int) -> int:
        """Further delay of a computation that begins now."""
        return 0
