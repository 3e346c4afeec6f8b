"""The reset after a stop, explored exhaustively: every order of up to six events, as a state machine."""

import dataclasses
import itertools
from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import Component, Output, Publication, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
from pipeline.deployment.messages import (
    EmergencyStop,
    InterfaceRule,
    JointCommand,
    Joystick,
    Level,
    MachineCommand,
    Message,
    Release,
    Reset,
    SupervisorState,
    Topic,
)
from tests.deployment.machines import BackAndForth, bobcat, estimator, frames, paper, server

MACHINE, PAPER = bobcat(), paper()
TICK_S = MACHINE.dt_s
NEUTRAL_TICKS = 2
CONFIG = dataclasses.replace(
    PAPER,
    supervisor=dataclasses.replace(
        PAPER.supervisor, rules=["command_value"], neutral_s=NEUTRAL_TICKS * TICK_S, period_s=TICK_S
    ),
    interface=dataclasses.replace(  # as many signs of life as in the paper's profile: one of them may be late
        PAPER.interface,
        supervised=True,
        maximum_supervisor_silence_s=(
            PAPER.interface.maximum_supervisor_silence_s / PAPER.supervisor.period_s * TICK_S
        ),
    ),
)
# A violation, the acknowledgement of the stop, sticks, another server's command, a tick; the acknowledgement of a
# former stop, and a supervisor that is killed and started again.
EVENTS = ("violation", "acknowledge", "deflect", "let_go", "command", "tick", "old", "restart")


LATCHED = (
    Topic.emergency_stop,
    Topic.release,
    Topic.supervisor_state,
)  # topics keep no order among each other


class Graph:
    """Supervisor, interface and teleoperation without delays, and what the requirement says of each moment.

    Messages of topics that are `late` arrive after all others of the next event.
    """

    def __init__(self, late: Sequence[Topic] = ()) -> None:
        self.late, self.held = late, deque[Publication]()
        self.teleoperation = TeleoperationServer(MACHINE, CONFIG.teleoperation)
        self.interface = ControlInterface(MACHINE, CONFIG.interface)
        self.supervisor = supervise(MACHINE, CONFIG, MACHINE_DIRECTORY)
        self.now_ns, self.sequence, self.stops = 0, 0, [0]
        self.heard_ns, self.released_ns = 0, 0  # newest stops: that the interface knows, that are over
        self.moved: list[np.ndarray] = []
        # The requirement, written down without the components: when motion is allowed.
        self.is_stopped = self.is_acknowledged = self.is_deflected = False
        self.neutral_ticks = 0
        self._tick()

    @property
    def components(self) -> tuple[Component, ...]:
        return self.supervisor, self.interface, self.teleoperation

    @property
    def state(self) -> tuple[str, bool, int]:
        """Of the requirement: who is waited for, whether a stick is held, how long all have been neutral."""
        waits = "released" if not self.is_stopped else "sticks" if self.is_acknowledged else "operator"
        return waits, self.is_deflected, self.neutral_ticks if waits == "sticks" else 0

    @property
    def is_unheard(self) -> bool:
        """Whether a stop is under way while the interface knows of none: nobody can obey it yet."""
        is_sent = any(output.topic is Topic.emergency_stop for output in self.held)
        return is_sent and self.heard_ns <= self.released_ns

    def happen(self, event: str) -> None:
        self.now_ns += 1
        self.moved.clear()
        held, self.held = self.held, deque()
        if event in ("violation", "command"):
            self.sequence += 1
            values = np.array([2.0 if event == "violation" else 1.0, 0, 0, 0], np.float32)
            command = JointCommand(self.now_ns, "server", self.sequence, self.now_ns, values)
            self._require(stops=event == "violation")
            self._send(Publication(Topic.requested_commands, command))
        elif event in ("deflect", "let_go"):
            self.is_deflected = event == "deflect"
            if self.is_deflected:
                self.neutral_ticks = 0
            self._stick()
        elif event in ("acknowledge", "old"):
            stop_ns = self.stops[-1] if event == "acknowledge" else self.stops[max(len(self.stops) - 2, 0)]
            if event == "acknowledge" and self.is_stopped and not self.is_acknowledged:
                self.is_acknowledged, self.neutral_ticks = True, 0
            self._send(Publication(Topic.reset, Reset(self.now_ns, stop_ns)))
        elif event == "restart":
            self.supervisor = supervise(MACHINE, CONFIG, MACHINE_DIRECTORY)
            self.is_acknowledged = False
        else:
            self._tick()
        self._deliver(held)

    def _require(self, stops: bool) -> None:
        self.neutral_ticks = 0
        if stops:
            self.is_stopped, self.is_acknowledged = True, False

    def _tick(self) -> None:
        self.now_ns += nanoseconds(TICK_S)
        self._stick()
        if self.is_acknowledged and not self.is_deflected:
            self.neutral_ticks += 1
            if self.neutral_ticks >= NEUTRAL_TICKS:
                self.is_stopped = self.is_acknowledged = False
                self.released_ns = self.stops[-1]
        for component in self.components:
            self._send(*component.on_timer(self.now_ns))

    def _stick(self) -> None:
        axes = np.zeros(8)
        axes[CONFIG.teleoperation.axes[1]] = float(self.is_deflected)
        self._send(Publication(Topic.joystick, Joystick(self.now_ns, axes)))

    def _send(self, *outputs: Publication) -> None:
        self._deliver(self._at_once(outputs))

    def _at_once(self, outputs: Sequence[Output]) -> deque[Publication]:
        """What arrives at once; the operator knows of every stop."""
        for stop in (o.message for o in outputs if o.topic is Topic.emergency_stop):
            if stop.stamp_ns > self.stops[-1]:
                self.stops.append(stop.stamp_ns)
            if stop.rule in [*InterfaceRule]:  # its own
                self.heard_ns = max(self.heard_ns, stop.stamp_ns)
        self.held += [output for output in outputs if output.topic in self.late]
        return deque(output for output in outputs if output.topic not in self.late)

    def _deliver(self, queue: deque[Publication]) -> None:
        while queue:
            topic, message = queue.popleft()
            if isinstance(message, MachineCommand) and np.any(message.values):
                self.moved.append(message.values)
            elif isinstance(message, EmergencyStop | SupervisorState):
                told_ns = message.stamp_ns if isinstance(message, EmergencyStop) else message.stop_ns
                self.heard_ns = max(self.heard_ns, told_ns)
            for component in self.components:
                if topic in component.subscriptions:
                    queue += self._at_once(component.on_message(topic, message, self.now_ns))


def explore(length: int, late: Sequence[Topic]) -> Iterator[tuple[tuple[str, ...], Graph]]:
    """Graphs after each order of so many events, a stop before them; the requirement is checked at every event."""
    for events in itertools.product(EVENTS, repeat=length):
        graph = Graph(late)
        graph.happen("violation")
        assert graph.interface.is_muted
        for event in events:
            was_stopped = graph.is_stopped and not graph.is_unheard
            graph.happen(event)
            if event == "violation" or (was_stopped and (event != "tick" or graph.is_stopped)):
                assert not graph.moved, events
            if graph.moved:
                assert graph.is_deflected or event == "command", events  # nothing is left over
        yield events, graph


@pytest.mark.parametrize(
    ("length", "late"),
    [
        *((4, late) for n in range(4) for late in itertools.combinations(LATCHED, n)),
        *(pytest.param(6, late, marks=pytest.mark.long) for late in ((), LATCHED)),
    ],
)
def test_no_order_of_events_moves_the_machine_before_the_sticks_were_neutral(
    length: int, late: Sequence[Topic]
) -> None:
    ends = [(events, graph.state, graph.interface.is_muted) for events, graph in explore(length, late)]
    waits, held = ("operator", "sticks", "released"), (False, True)
    assert {state for _, state, _ in ends} == {*itertools.product(waits, held, [0]), ("sticks", False, 1)}
    released = {events for events, _, is_muted in ends if not is_muted}
    assert ("acknowledge", *["tick"] * (length - 1)) in released
    assert all("acknowledge" in events and events.count("tick") >= NEUTRAL_TICKS for events in released)


def test_the_sticks_move_the_machine_again_after_a_reset() -> None:
    graph = Graph()
    for event in ("deflect", "violation", "acknowledge", "tick", "tick", "tick"):
        graph.happen(event)
    assert graph.interface.is_muted  # the stick was held all the time
    for event in ("let_go", "tick", "tick"):
        graph.happen(event)
    assert not graph.interface.is_muted and not graph.moved
    for event in ("deflect", "tick"):
        graph.happen(event)
    assert graph.moved


def test_a_repeated_reset_repeats_a_lost_release() -> None:
    graph = Graph()
    for event in ("violation", "acknowledge"):
        graph.happen(event)
    graph.supervisor.on_timer(graph.now_ns + nanoseconds(NEUTRAL_TICKS * TICK_S))  # its messages are lost
    assert graph.supervisor.stop is None and graph.interface.is_muted
    graph.happen("acknowledge")
    assert not graph.interface.is_muted


STOP, RELEASE_S = EmergencyStop(nanoseconds(1.0), "invalid_command", ""), 2.0
AT_RELEASE = (
    (Topic.supervisor_state, SupervisorState(nanoseconds(RELEASE_S - TICK_S), STOP.rule, STOP.stamp_ns)),
    (Topic.release, Release(nanoseconds(RELEASE_S), STOP.stamp_ns)),
    (Topic.supervisor_state, SupervisorState(nanoseconds(RELEASE_S), "")),
)


def stopped(component: Component) -> Component:
    component.on_message(Topic.emergency_stop, STOP, STOP.stamp_ns)
    assert component.condition(STOP.stamp_ns).level is Level.error
    return component


@pytest.mark.parametrize("order", [*itertools.permutations(AT_RELEASE)])
def test_a_release_holds_in_whatever_order_the_topics_arrive(order: Sequence[tuple[Topic, Message]]) -> None:
    interface = stopped(ControlInterface(MACHINE, CONFIG.interface))
    said = [out for entry in order for out in interface.on_message(*entry, nanoseconds(RELEASE_S))]
    repeated = [(out.topic, out.message) for out in said if out.topic is Topic.emergency_stop]
    for heard in itertools.permutations([AT_RELEASE[1], *repeated]):
        for component in (
            interface,
            stopped(TeleoperationServer(MACHINE, CONFIG.teleoperation)),
            stopped(server(BackAndForth())),
            stopped(MachineDriver(MACHINE, frames(), estimator())),
        ):
            for entry in heard:
                component.on_message(*entry, nanoseconds(RELEASE_S))
            assert component.condition(nanoseconds(RELEASE_S)).level is not Level.error


@pytest.mark.parametrize("is_stop_heard", [True, False])
def test_an_interface_whose_clock_was_set_back_stops_after_a_release_too(is_stop_heard: bool) -> None:
    interface = ControlInterface(MACHINE, CONFIG.interface)
    if is_stop_heard:
        stopped(interface)
    interface.on_message(*AT_RELEASE[1], nanoseconds(RELEASE_S))
    assert not interface.is_muted
    now_ns = STOP.stamp_ns // 2
    interface.on_message(Topic.supervisor_state, SupervisorState(now_ns, ""), now_ns)
    command = JointCommand(now_ns, "server", 1, now_ns, np.full(MACHINE.n_joint, 2.0))
    said = interface.on_message(Topic.requested_commands, command, now_ns)
    assert interface.is_muted and said[0].message.stamp_ns > STOP.stamp_ns


def test_a_stop_that_the_supervisor_never_heard_of_is_repeated_but_not_at_every_sign_of_life() -> None:
    interface, silence_s = (
        ControlInterface(bobcat(), CONFIG.interface),
        CONFIG.interface.maximum_supervisor_silence_s,
    )
    stop = EmergencyStop(nanoseconds(1.0), "invalid_command", "")
    interface.on_message(Topic.emergency_stop, stop, stop.stamp_ns)
    signs_s = 1.0 + 0.1 * silence_s * np.arange(1, 30)
    said = []
    for at_s in signs_s:
        sign = SupervisorState(nanoseconds(at_s), "")
        outputs = interface.on_message(Topic.supervisor_state, sign, nanoseconds(at_s))
        assert all(output == Publication(Topic.emergency_stop, stop) for output in outputs)
        said += [at_s] * len(outputs)
    np.testing.assert_allclose(said, 1.0 + 1.1 * silence_s * np.array([1, 2]))
