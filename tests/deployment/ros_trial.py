"""A trial on the real graph: `python -m tests.deployment.ros_trial FOLDER`, a process of its own, as rospy allows one
node per process. What was seen goes to FOLDER/trial.json; the time to zero outputs is printed.
"""

import contextlib
import json
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import can
import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.messages import JointCommand, Joystick, ReachGoal, Reset, Topic
from pipeline.deployment.transports.ros1.can_bus import CanBusConfig, open_bus
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.launch import graph
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.deployment.transports.ros1.operator import Operator
from pipeline.deployment.transports.ros1.reach_action import ReachClient
from pipeline.errors import InputError
from tests.deployment.ros_node import CAN, NODES, SIMULATED, bus_config, config

START_S = 180.0
PATIENCE_S = 30.0  # for goals that take one or two seconds
NO_COMMAND = 2.0
MOVING_S = 0.5
WATCHED_S = 0.5
ROGUE_PERIOD_S = 0.02


def run(folder: Path) -> dict:
    """Two goals in peace; some that end early; one in which somebody sends an impossible command; more; a reset."""
    rospy, machine = require_ros(), load_machine("bobcat_e10")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    drivers = CAN if carries_frames(bus_config(port)) else SIMULATED
    commands = {
        name: [sys.executable, "-m", "tests.deployment.ros_node", name, str(folder), str(port)]
        for name in (*drivers, *NODES)
    }
    with graph(commands, folder) as processes:
        operator = Operator(machine)
        operator.wait_for_server(START_S, lambda: all(p.poll() is None for p in processes.values()))
        wait_for_states(operator)
        results = operator.pursue([goal(0), goal(1)], PATIENCE_S)
        early, feedback = end_early(operator)
        operator.give(goal(2))
        time.sleep(MOVING_S)
        requests = carriers(machine)[Topic.requested_commands]
        rogue = rospy.Publisher(requests.name, requests.ros_type, queue_size=10)
        while rogue.get_num_connections() < 3:  # interface, supervisor, and the operator's own recorder
            time.sleep(ROGUE_PERIOD_S)

        def send(number: int, value: float) -> None:
            now_ns = operator.now_ns()
            command = JointCommand(now_ns, "rogue", number, now_ns, np.full(machine.n_joint, value))
            rogue.publish(requests.to_ros(command))

        send(0, NO_COMMAND)
        results.append(operator.result(PATIENCE_S))
        rogue_from_ns = operator.now_ns()
        for number in range(1, round(WATCHED_S / ROGUE_PERIOD_S)):
            send(number, 1.0)
            time.sleep(ROGUE_PERIOD_S)
        operator.give(goal(3))
        results.append(operator.result(PATIENCE_S))
        time.sleep(WATCHED_S)
        let_go_ns = reset(operator)
        time.sleep(WATCHED_S)  # until the server has heard of it, too; nothing moves by itself
        released_ns = operator.now_ns()
        results += operator.pursue([goal(7)], PATIENCE_S)
    heard = operator.recorder
    return {
        "drivers": drivers,
        "results": [asdict(result) for result in results],
        "early": early,
        "feedback": feedback,
        "command_s": [time_ns / NANOSECONDS for time_ns, _ in heard.commands],
        "moves": [bool(np.any(command.values)) for _, command in heard.commands],
        "position": [state.position.tolist() for _, state in heard.states],
        "stops": [{"rule": stop.rule, "s": stop.stamp_ns / NANOSECONDS} for stop in heard.stops],
        "outputs": [[out.stamp_ns / NANOSECONDS, bool(np.any(out.values))] for out in operator.outputs],
        "rogue_from_s": rogue_from_ns / NANOSECONDS,
        "let_go_s": let_go_ns / NANOSECONDS,
        "releases_s": [release.stamp_ns / NANOSECONDS for release in heard.releases],
        "released_s": released_ns / NANOSECONDS,
    }


def reset(operator: Operator) -> int:
    """Acknowledge the stop with a stick held, let go later, wait for the release; when it was let go, ns."""
    rospy, settings, topics = require_ros(), config(), carriers(load_machine("bobcat_e10"))
    axes = np.ones(max(settings.teleoperation.axes) + 1)
    stick, reset = (
        rospy.Publisher(topics[topic].name, topics[topic].ros_type, queue_size=10)
        for topic in (Topic.joystick, Topic.reset)
    )
    while not (
        stick.get_num_connections() and reset.get_num_connections() > 1
    ):  # as the operator records resets
        time.sleep(ROGUE_PERIOD_S)
    stick.publish(topics[Topic.joystick].to_ros(Joystick(operator.now_ns(), axes)))
    time.sleep(WATCHED_S)
    stop_ns = max(stop.stamp_ns for stop in operator.recorder.stops)
    reset.publish(topics[Topic.reset].to_ros(Reset(operator.now_ns(), stop_ns)))
    time.sleep(2 * settings.supervisor.neutral_s)
    let_go_ns = operator.now_ns()
    stick.publish(topics[Topic.joystick].to_ros(Joystick(let_go_ns, 0 * axes)))
    deadline = time.monotonic() + PATIENCE_S
    while not operator.recorder.releases:
        assert time.monotonic() < deadline, "no release"
        time.sleep(ROGUE_PERIOD_S)
    return let_go_ns


def carries_frames(bus: CanBusConfig) -> bool:
    """Whether the bus joins processes here: it takes a network interface that does multicast."""
    try:
        with open_bus(bus) as here, open_bus(bus) as there:
            here.send(can.Message(arbitration_id=1, is_extended_id=False))
            return there.recv(timeout=1.0) is not None
    except (InputError, can.CanError):
        return False


def goal(number: int, height_m: float = 0.5) -> ReachGoal:
    return ReachGoal(number, np.array([1.5, 0.1 * number, height_m]), np.array([1.0, 0, 0, 0]))


def end_early(operator: Operator) -> tuple[dict[str, str | None], list[tuple[float, float]]]:
    """Goals of two clients: replaced by a newer one, cancelled, and one that nobody could pursue."""
    other = ReachClient()
    assert other.is_connected(PATIENCE_S)
    operator.give(goal(4))
    time.sleep(MOVING_S)
    other.give(goal(5))
    replaced = operator.result(PATIENCE_S)
    time.sleep(MOVING_S)
    other.cancel()
    cancelled, feedback = other.result(PATIENCE_S), other.feedback
    with slow_sending():
        operator.give(goal(6, height_m=np.nan))
    refused = operator.result(PATIENCE_S)
    assert cancelled is not None
    return {
        "replaced": replaced.outcome,
        "cancelled": cancelled.outcome,
        "refused": refused.outcome,
    }, feedback


@contextlib.contextmanager
def slow_sending() -> Iterator[None]:
    """As on a busy computer: the server has answered before the call that sends a goal returns."""
    import actionlib

    send = actionlib.ActionClient.send_goal

    def slowly(*arguments, **named):
        handle = send(*arguments, **named)
        time.sleep(MOVING_S)
        return handle

    actionlib.ActionClient.send_goal = slowly
    try:
        yield
    finally:
        actionlib.ActionClient.send_goal = send


def wait_for_states(operator: Operator) -> None:
    """Until the operator hears the driver: the whole chain is connected then but for what starts with a goal."""
    deadline = time.monotonic() + START_S
    while not operator.recorder.states:
        assert time.monotonic() < deadline, "no joint states"
        time.sleep(0.05)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    seen = run(target)
    (target / "trial.json").write_text(json.dumps(seen))
    stop_s = seen["stops"][0]["s"]
    zero_s = [at_s for at_s, moves in seen["outputs"] if at_s >= stop_s and not moves]
    if zero_s:
        print(
            f"the PLC's outputs were zero {1e3 * (zero_s[0] - stop_s):.1f} ms after the emergency stop was sent"
        )
