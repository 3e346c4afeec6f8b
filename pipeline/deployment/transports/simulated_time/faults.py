"""What can go wrong in the simulated graph: the hook that faults are written against."""

from collections.abc import Sequence

from pipeline.deployment.messages import Message, Topic


class Fault:
    """Base of all faults: nothing goes wrong. Times are the simulation's own, ns."""

    def deliver(
        self, topic: Topic, target: str, message: Message, time_ns: int
    ) -> Sequence[tuple[int, Message]] | None:
        """What arrives in place of a message that is due now: extra delays, ns, and messages; None: just it."""
        return None

    def is_running(self, component: str, time_ns: int) -> bool:
        """Whether a component takes messages and ticks."""
        return True

    def clock_error_ns(self, component: str, time_ns: int) -> int:
        """By how much the component's clock is ahead."""
        return 0

    def extra_computation_ns(self, component: str, time_ns: int) -> int:
        """Further delay of a computation that begins now."""
        return 0
