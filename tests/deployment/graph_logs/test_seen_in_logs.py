"""The graph's own topics in bags, and what they tell, against stamps that were chosen."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.graph_logs.evaluate_logs import evaluate_deployment
from pipeline.deployment.graph_logs.graph_topics import DEFINITIONS, read_graph_topics
from pipeline.deployment.graph_logs.seen_in_logs import delay_samples, delays_seen, safety_events, safety_seen
from pipeline.deployment.messages import (
    EmergencyStop,
    GoalOutcome,
    JointCommand,
    JointState,
    MachineCommand,
    ReachResult,
    Release,
    TargetPose,
    Topic,
)
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from tests.deployment.machines import MIDDLE, bobcat

BEGIN_NS = 1_775_000_000_000_000_000
MS = 1_000_000
N = 50  # ticks of 50 ms


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    """Every tick a joint state, recorded 3 ms after its stamp; a request 5 ms after that stamp, decided on every
    fourth one, passed on 2 ms later; one request is lost on the way to the recorder. Half way an emergency."""
    folder, recorder = tmp_path_factory.mktemp("deployment"), Recorder()
    pose = TargetPose(BEGIN_NS, np.array([2.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))
    recorder(Topic.target_pose, pose, BEGIN_NS)
    for n in range(N):
        stamp_ns = BEGIN_NS + 50 * MS * n
        recorder(Topic.joint_states, JointState(stamp_ns, MIDDLE, np.zeros(4)), stamp_ns + 3 * MS)
        observed_ns = BEGIN_NS + 50 * MS * (n - n % 4)
        sent_ns = stamp_ns + 5 * MS
        values = np.array([1, 0, -1, 0], np.float32) if n < N // 2 + 2 else np.zeros(4, np.float32)
        request = JointCommand(sent_ns, "autonomous_server", n + 1, observed_ns, values, n == N - 1)
        if n != 7:
            recorder(Topic.requested_commands, request, sent_ns)
        recorder(Topic.joint_commands, MachineCommand(sent_ns + 2 * MS, values), sent_ns + 2 * MS)
    stop_ns = BEGIN_NS + 50 * MS * (N // 2)
    recorder(Topic.emergency_stop, EmergencyStop(stop_ns, "joint_limits", "swing at 0.950 rad"), stop_ns)
    recorder(Topic.release, Release(stop_ns + 1000 * MS, stop_ns - 1), stop_ns + 1000 * MS)
    recorder(Topic.result, ReachResult(stop_ns + MS, 0, GoalOutcome.stopped, N // 2), stop_ns + MS)
    recorder.write(folder / "logs/drive", bobcat())
    return folder / "logs"


def test_a_bag_gives_back_what_the_graph_said(bag) -> None:
    (entry,) = find_logs(bag)
    record = read_graph_topics(entry)
    assert [request.sequence for _, request in record.requests] == [n + 1 for n in range(N) if n != 7]
    time_ns, request = record.requests[9]
    assert (time_ns, request.stamp_ns) == (BEGIN_NS + 505 * MS + 0, BEGIN_NS + 505 * MS)
    assert request.observed_ns == BEGIN_NS + 400 * MS and request.source == "autonomous_server"
    np.testing.assert_array_equal(request.values, [1, 0, -1, 0])
    assert record.requests[-1][1].is_last
    assert [stop.rule for _, stop in record.stops] == ["joint_limits"]
    assert [result.outcome for _, result in record.results] == [GoalOutcome.stopped]


def test_delays_are_those_that_were_put_in(bag) -> None:
    (entry,) = find_logs(bag)
    seen = evaluate_deployment([read_log(entry, bobcat())], [read_graph_topics(entry)])["delays"]
    medians = {name: round(1e3 * values["median"], 6) for name, values in seen.items() if name != "requests"}
    assert medians == {
        "joint_state_recording_s": 3.0,
        "joint_state_interval_s": 50.0,
        "command_interval_s": 50.0,
        "state_age_at_command_s": 7.0,
        "decision_age_s": 5.0,
        "request_to_command_s": 2.0,
    }
    assert seen["requests"] == {"n": N - 1, "lost": 1, "out_of_order": 0}
    assert seen["decision_age_s"]["n"] == -(-N // 4)
    assert seen["joint_state_interval_s"]["n"] == N - 1


def test_safety_events_say_who_which_rule_and_when(bag, capsys) -> None:
    (entry,) = find_logs(bag)
    safety = evaluate_deployment([read_log(entry, bobcat())], [read_graph_topics(entry)])["safety"]
    assert [(event["who"], event["rule"]) for event in safety["events"]] == [
        ("control_supervisor", "joint_limits"),
        ("autonomous_server", "stopped"),
    ]
    assert safety["events"][0]["t"] == pytest.approx(
        0.05 * (N // 2) - 0.003
    )  # since the first recorded joint state
    assert safety["outcomes"] == {"stopped": 1} and safety["emergency_stops"] == 1
    assert safety["commands_after_stop"] == 2  # a graph whose interface did not mute
    assert "emergency stop after 1.25 s of drive: joint_limits" in capsys.readouterr().out
    raw, record = read_log(entry, bobcat()), read_graph_topics(entry)
    ((stop_ns, stop),) = record.stops
    released_ns = stop_ns + 50 * MS  # one of both commands is before it
    of_another, of_this = ((released_ns, Release(released_ns, stop.stamp_ns - early)) for early in (1, 0))
    for releases, n_after in ([of_another], 2), ([of_this], 1):
        assert (
            safety_events("drive", raw, record._replace(releases=releases))["commands_after_stop"] == n_after
        )
    both = safety_seen([safety, safety])
    assert both["outcomes"] == {"stopped": 2} and len(both["events"]) == 4


def test_a_bag_without_the_graph_s_topics_tells_what_any_log_tells(bag, tmp_path) -> None:
    (entry,) = find_logs(bag)
    raw, nothing = (
        read_log(entry, bobcat()),
        read_graph_topics(entry)._replace(requests=[], results=[], stops=[], releases=[]),
    )
    samples = delay_samples(raw, nothing)
    assert set(samples) == {
        "joint_state_recording",
        "joint_state_interval",
        "command_interval",
        "state_age_at_command",
    }
    assert "requests" not in delays_seen([samples], [nothing])
    assert set(evaluate_deployment([raw], [nothing])) == {"delays"}
    assert safety_events("drive", raw, nothing)["events"] == []


def test_what_rosbag_recorded_on_the_ros_graph_is_read_alike(tmp_path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    name = "hydraulic_arm/msg/EmergencyStop"
    store.register(get_types_from_msg((DEFINITIONS / "EmergencyStop.msg").read_text(), name))
    time = store.types["builtin_interfaces/msg/Time"](sec=12, nanosec=5)
    stop = store.types[name](stamp=time, rule="command_value", detail="command [2.0]")
    with Rosbag1Writer(tmp_path / "drive.bag") as writer:
        connection = writer.add_connection("/emergency_stop", name, typestore=store)
        writer.write(connection, BEGIN_NS, store.serialize_ros1(stop, name))
    (entry,) = find_logs(tmp_path)
    record = read_graph_topics(entry)
    assert record.stops == [(BEGIN_NS, EmergencyStop(12_000_000_005, "command_value", "command [2.0]"))]
