"""What every component tells of itself once a second: its condition, and the rates of its messages and ticks."""

from collections import Counter

from pipeline.deployment.component import NANOSECONDS, Component, Publication, nanoseconds
from pipeline.deployment.messages import Diagnostics, Status, Topic

PERIOD_NS = nanoseconds(1.0)  # as ROS's own components do


class DiagnosticReporter:
    """Counts what a transport carries for one component, and reports its rates since the last report."""

    def __init__(self, component: Component, now_ns: int) -> None:
        self._component = component
        self._since_ns = now_ns
        self._counts = Counter({_received(topic): 0 for topic in component.subscriptions})

    def received(self, topic: Topic) -> None:
        """Count a message that arrived."""
        self._counts[_received(topic)] += 1

    def sent(self, topic: Topic) -> None:
        """Count a message that left."""
        self._counts[f"{topic} sent, Hz"] += 1

    def ticked(self) -> None:
        """Count a tick of the timer."""
        self._counts["ticks, Hz"] += 1

    def report(self, now_ns: int) -> Publication:
        """The component's diagnostics; what was counted before and came no more has a rate of zero."""
        elapsed_s = max(now_ns - self._since_ns, 1) / NANOSECONDS
        rates = {name: f"{n / elapsed_s:.1f}" for name, n in sorted(self._counts.items())}
        self._counts = Counter(dict.fromkeys(self._counts, 0))
        self._since_ns = now_ns
        level, text, values = self._component.condition(now_ns)
        status = Status(self._component.name, level, text, {**values, **rates})
        return Publication(Topic.diagnostics, Diagnostics(now_ns, (status,)))


def _received(topic: Topic) -> str:
    return f"{topic} received, Hz"
