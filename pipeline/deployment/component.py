"""The interface of a graph component, independent of the transport.

A component never reads a clock and never waits. A transport passes messages and timer ticks with the time of the
component's clock, and executes the returned outputs.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pipeline.deployment.messages import Level, Message, Topic

NANOSECONDS = 1_000_000_000


class Publication(NamedTuple):
    """A message to send."""

    topic: Topic
    message: Message


class Computation(NamedTuple):
    """Long work: the transport calls `compute(request)` outside the loop, then `on_computed(result)`."""

    request: Any


Output = Publication | Computation


class Condition(NamedTuple):
    """How a component is: level, the same in words, details by name."""

    level: Level
    text: str
    values: Mapping[str, str] = {}


class Component:
    """Base of all components.

    Attributes:
        name: name of the node.
        subscriptions: topics that it receives.
        period_ns: timer period; None without a timer.
    """

    name: str
    subscriptions: tuple[Topic, ...] = ()
    period_ns: int | None = None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Process a message."""
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Process a timer tick."""
        return ()

    def condition(self, now_ns: int) -> Condition:
        """How the component is, for its diagnostics."""
        return Condition(Level.ok, "runs")


class ComputingComponent(Component, ABC):
    """Base of the components that return a `Computation`."""

    @abstractmethod
    def compute(self, request: Any) -> Any:
        """Execute a `Computation` without changing the component's state."""

    @abstractmethod
    def on_computed(self, result: Any, now_ns: int) -> Sequence[Output]:
        """Process the result of a `Computation`."""


def nanoseconds(seconds: float) -> int:
    """Seconds as whole nanoseconds."""
    return round(seconds * NANOSECONDS)
