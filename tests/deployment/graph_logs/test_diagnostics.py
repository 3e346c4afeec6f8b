"""What components tell of themselves, read from a bag by rosbags' stock types: condition, reasons, rates, events."""

import uuid
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.deployment.messages import JointCommand, Joystick, Level, ReachGoal, Reset, Topic
from pipeline.deployment.transports.simulated_time.delays import no_delays
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.logs.formats.discovery.discover import find_logs
from tests.deployment.fault_cases import Killed, Later
from tests.deployment.machines import BackAndForth, bobcat, can_graph, paper

ACTING = ("autonomous_server", "control_interface", "control_supervisor", "bobcat_e10_driver", "plc")
GRAPH = (*ACTING, "emcb_200u_driver")
STOPPED = "command_order: command 3 of rogue after 1"
STOP_S, RESET_S, RELEASED_S, GOAL_S, KILL_S, END_S = 2.5, 4.5, 6.5, 7.5, 8.5, 11.2


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A goal, a command out of order, a reset, another goal; at last the CAN driver dies."""
    folder, recorder, channel = tmp_path_factory.mktemp("graph"), Recorder(), uuid.uuid4().hex
    killed = Later(Killed("emcb_200u_driver"), nanoseconds(KILL_S - 1.0))
    goal = ReachGoal(1, np.zeros(3), np.array([1.0, 0, 0, 0]))
    with can.Bus(channel, interface="virtual") as host, can.Bus(channel, interface="virtual") as machine:
        components = can_graph(BackAndForth(), host, machine, ["command_value", "command_order"])
        graph = SimulatedGraph(
            components, no_delays(), np.random.SeedSequence(0), faults=[killed], taps=[recorder]
        )
        graph.send(Topic.goal, goal)
        graph.run(nanoseconds(STOP_S))
        now_ns = graph.time_ns
        for number in (1, 3):
            rogue = JointCommand(now_ns, "rogue", number, now_ns, np.zeros(4))
            graph.send(Topic.requested_commands, rogue)
        graph.run(nanoseconds(RESET_S))
        graph.send(Topic.joystick, Joystick(graph.time_ns, np.zeros(8)))
        graph.send(Topic.reset, Reset(graph.time_ns, recorder.stops[-1].stamp_ns))
        graph.run(nanoseconds(GOAL_S))
        graph.send(Topic.goal, goal)
        graph.run(nanoseconds(END_S))
    recorder.write(folder / "drive", bobcat())
    return folder / "drive"


def told(bag: Path) -> Iterator[tuple[float, str, int, str, dict[str, str]]]:
    """Time, s, name, level, message and values of each status."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        assert [c.msgtype for c in connections] == ["diagnostic_msgs/msg/DiagnosticArray"]
        for connection, time_ns, data in reader.messages(connections):
            array = reader.deserialize(data, connection.msgtype)
            assert array.header.stamp.sec * 10**9 + array.header.stamp.nanosec == time_ns
            for status in array.status:
                values = {pair.key: pair.value for pair in status.values}
                yield time_ns * 1e-9, status.name, status.level, status.message, values


def at(bag: Path, second: float, name: str) -> tuple[int, str, dict[str, str]]:
    """The first status of a component from a time on."""
    return next(entry[2:] for entry in told(bag) if entry[0] >= second and entry[1] == name)


def test_every_component_tells_once_a_second_while_it_runs(bag: Path) -> None:
    seconds = {name: [round(s) for s, who, *_ in told(bag) if who == name] for name in GRAPH}
    assert {who for _, who, *_ in told(bag)} == set(GRAPH)
    assert all(seconds[name] == list(range(1, 12)) for name in ACTING)
    assert seconds["emcb_200u_driver"] == list(range(1, 9))


def test_rates_are_those_of_the_last_second(bag: Path) -> None:
    _, _, moving = at(bag, 2, "control_interface")
    _, _, stopped = at(bag, 4, "control_interface")
    rate_hz = 1.0 / bobcat().dt_s
    assert float(moving["requested_commands received, Hz"]) == pytest.approx(rate_hz, abs=1)
    assert float(moving["ticks, Hz"]) == pytest.approx(1.0 / paper().interface.period_s, abs=1)
    assert float(stopped["requested_commands received, Hz"]) == 0.0
    assert float(at(bag, 10, "bobcat_e10_driver")[2]["can_from_machine received, Hz"]) == 0.0


def test_a_stop_is_an_error_with_its_reason_until_it_is_released(bag: Path) -> None:
    for name in ("autonomous_server", "control_interface", "bobcat_e10_driver", "control_supervisor"):
        (before, _, values), (during, text, _), (after, _, kept) = (
            at(bag, s, name) for s in (2, 4, RELEASED_S)
        )
        assert (before, during, after) == (Level.ok, Level.error, Level.ok)
        assert text == f"stopped by {STOPPED}"
        assert (values["last stop"], kept["last stop"]) == ("none", STOPPED)
    assert at(bag, 5, "control_supervisor")[1].startswith("acknowledged, waits for neutral sticks")
    assert at(bag, 4, "plc")[:2] == (Level.error, "stopped by an emergency frame")


def test_the_state_of_every_rule_is_told(bag: Path) -> None:
    _, _, values = at(bag, 4, "control_supervisor")
    assert values["rule command_order"] == "stopped: command 3 of rogue after 1"
    assert values["rule command_value"] == "no objection"


def test_the_server_tells_what_it_pursues(bag: Path) -> None:
    assert at(bag, 2, "autonomous_server")[1].startswith("pursues goal 1, tick ")
    _, text, values = at(bag, RELEASED_S, "autonomous_server")
    assert (text, values["last goal"]) == ("waits for a goal", "1: stopped")


def test_stop_acknowledgement_and_release_are_in_the_bag(bag: Path) -> None:
    (entry,) = find_logs(bag.parent)
    record = read_graph_topics(entry)
    ((stop_ns, stop),) = record.stops
    ((reset_ns, reset),) = record.resets
    ((release_ns, release),) = record.releases
    assert stop_ns < reset_ns < release_ns
    assert stop.stamp_ns == reset.stop_ns == release.stop_ns
    assert len(record.diagnostics) == len(list(told(bag)))
    assert record.diagnostics[0][1].statuses[0].level is Level.ok
