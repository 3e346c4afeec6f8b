"""The components in simulated time: events in a queue, in order of time and then of creation.

Messages of one link (topic and receiver) keep their order, as with TCP. Timers start at random phases, as in the real
graph. The same seed gives the same run.
"""

import heapq
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.deployment.component import Component, Computation, ComputingComponent, Output, Publication
from pipeline.deployment.diagnostics import PERIOD_NS, DiagnosticReporter
from pipeline.deployment.messages import Message, Topic
from pipeline.deployment.transports.simulated_time.delays import DelaySampler, Distribution
from pipeline.deployment.transports.simulated_time.faults import Fault

Tap = Callable[[Topic, Message, int], None]


_Event = tuple[int, int, Callable[..., None], tuple[Any, ...]]  # time, ns; number; function and arguments


class SimulatedGraph:
    """Runs components as separate nodes, faster than real time."""

    def __init__(
        self,
        components: Sequence[Component],
        delays: Mapping[str, Distribution],
        seed: np.random.SeedSequence,
        start_ns: int = 0,
        faults: Sequence[Fault] = (),
        taps: Sequence[Tap] = (),
    ) -> None:
        """Starts all components.

        Args:
            components: components with unique names.
            delays: distributions per link (`delays.LINKS`).
            seed: seed of delays and phases; each link's draws are independent of the others.
            start_ns: time of the first event.
            faults: injected faults.
            taps: called with topic, message and time of every publication, like a recorder at the sender; nobody else
                hears the components' diagnostics.
        """
        self.time_ns = start_ns
        self.components = {component.name: component for component in components}
        self._delays = delays
        self._faults = faults
        self._taps = taps
        self._events: list[_Event] = []
        self._n_events = 0
        links = [(topic, c.name) for c in components for topic in c.subscriptions]
        phases, *seeds = seed.spawn(1 + len(links) + 2 * len(components))
        self._links = {
            link: DelaySampler(
                delays["observation" if link[0] is Topic.joint_states else "command"], seeds.pop()
            )
            for link in links
        }
        self._latest_ns = dict.fromkeys(links, start_ns)
        self._receivers: dict[Topic, list[str]] = {}
        for topic, name in links:
            self._receivers.setdefault(topic, []).append(name)
        self._computing = {c.name: DelaySampler(delays["inference"], seeds.pop()) for c in components}
        self._timers = {c.name: DelaySampler(delays["timer"], seeds.pop()) for c in components}
        self._reporters = {c.name: DiagnosticReporter(c, start_ns) for c in components if taps}
        for name in self._reporters:
            self._schedule(start_ns + PERIOD_NS, self._report, name)
        random = np.random.default_rng(phases)
        for component in components:
            if component.period_ns is not None:
                phase_ns = int(random.integers(component.period_ns))
                self._schedule_tick(component, start_ns + phase_ns)

    def send(self, topic: Topic, message: Message) -> None:
        """Publish from outside the graph, now."""
        self._publish(topic, message)

    def run(self, until_ns: int, stop: Callable[[], bool] = lambda: False) -> None:
        """Handle all events up to a time, or until `stop()`, which is called after each event."""
        while self._events and self._events[0][0] <= until_ns:
            self.time_ns, _, action, arguments = heapq.heappop(self._events)
            action(*arguments)
            if stop():
                return
        self.time_ns = until_ns

    def _schedule(self, time_ns: int, action: Callable[..., None], *arguments: Any) -> None:
        self._n_events += 1
        heapq.heappush(self._events, (time_ns, self._n_events, action, arguments))

    def _now(self, component: Component) -> int:
        if not self._faults:
            return self.time_ns
        return self.time_ns + sum(f.clock_error_ns(component.name, self.time_ns) for f in self._faults)

    def _is_running(self, component: Component) -> bool:
        return not self._faults or all(
            fault.is_running(component.name, self.time_ns) for fault in self._faults
        )

    def _schedule_tick(self, component: Component, due_ns: int) -> None:
        """Schedule a timer's wake-up with its lateness; a lateness beyond a period does not delay the next tick."""
        assert component.period_ns is not None
        timer, late_ns = self._timers[component.name], component.period_ns
        while late_ns >= component.period_ns:
            late_ns = max(timer.draw_ns(), 0)
            next_ns = due_ns + component.period_ns if late_ns < component.period_ns else None
            self._schedule(due_ns + late_ns, self._wake, component, next_ns)
            due_ns += component.period_ns

    def _wake(self, component: Component, next_ns: int | None) -> None:
        if next_ns is not None:
            self._schedule_tick(component, next_ns)
        if self._is_running(component):
            if self._reporters:
                self._reporters[component.name].ticked()
            self._carry_out(component, component.on_timer(self._now(component)))

    def _deliver(self, component: Component, topic: Topic, message: Message) -> None:
        if self._is_running(component):
            if self._reporters:
                self._reporters[component.name].received(topic)
            self._carry_out(component, component.on_message(topic, message, self._now(component)))

    def _finish(self, component: ComputingComponent, result: Any) -> None:
        if self._is_running(component):
            self._carry_out(component, component.on_computed(result, self._now(component)))

    def _report(self, name: str) -> None:
        self._schedule(self.time_ns + PERIOD_NS, self._report, name)
        if self._is_running(component := self.components[name]):
            self._publish(*self._reporters[name].report(self._now(component)))

    def _carry_out(self, component: Component, outputs: Sequence[Output]) -> None:
        for output in outputs:
            if isinstance(output, Publication):
                if self._reporters:
                    self._reporters[component.name].sent(output.topic)
                self._publish(output.topic, output.message)
            elif isinstance(output, Computation):
                assert isinstance(component, ComputingComponent)
                delay_ns = max(self._computing[component.name].draw_ns(), 0)
                delay_ns += sum(f.extra_computation_ns(component.name, self.time_ns) for f in self._faults)
                self._schedule(
                    self.time_ns + delay_ns, self._finish, component, component.compute(output.request)
                )

    def _publish(self, topic: Topic, message: Message) -> None:
        for tap in self._taps:
            tap(topic, message, self.time_ns)
        for name in self._receivers.get(topic, ()):
            delay_ns = self._links[topic, name].draw_ns()
            if delay_ns < 0:
                continue
            arrival_ns = max(self.time_ns + delay_ns, self._latest_ns[topic, name])
            self._latest_ns[topic, name] = arrival_ns
            self._schedule(arrival_ns, self._arrive, name, topic, message)

    def _arrive(self, name: str, topic: Topic, message: Message) -> None:
        component = self.components[name]
        for fault in self._faults:
            replaced = fault.deliver(topic, name, message, self.time_ns)
            if replaced is not None:
                for delay_ns, other in replaced:
                    self._schedule(self.time_ns + delay_ns, self._deliver, component, topic, other)
                return
        self._deliver(component, topic, message)
