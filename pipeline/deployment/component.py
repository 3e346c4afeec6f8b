"""What a component of the graph is, whatever carries its messages.

A component never reads a clock and never waits: a transport hands it messages and timer ticks together with the
time of the component's clock, and carries out what it returns.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

from pipeline.deployment.messages import Message, Topic

NANOSECONDS = 1_000_000_000


class Publication(NamedTuple):
    """A message to send."""

    topic: Topic
    message: Message


class Computation(NamedTuple):
    """Work that takes time: the transport calls `compute(request)` beside the loop, then `on_computed(result)`."""

    request: Any


Output = Publication | Computation


class Component:
    """Base of all components.

    Attributes:
        name: of the node.
        subscriptions: topics whose messages it takes.
        period_ns: between two ticks of its timer; None without one.
    """

    name: str
    subscriptions: tuple[Topic, ...] = ()
    period_ns: int | None = None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Take a message in."""
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Do what is due at a tick."""
        return ()


class ComputingComponent(Component, ABC):
    """Base of the components that return a `Computation`."""

    @abstractmethod
    def compute(self, request: Any) -> Any:
        """Carry a `Computation` out, without touching the component's state."""

    @abstractmethod
    def on_computed(self, result: Any, now_ns: int) -> Sequence[Output]:
        """Take the result of a `Computation` in."""


def nanoseconds(seconds: float) -> int:
    """Seconds as whole nanoseconds."""
    return round(seconds * NANOSECONDS)
