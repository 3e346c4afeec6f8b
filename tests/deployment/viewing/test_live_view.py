"""A viewer that connects while the graph runs: a client of the protocol that is not ours, messages by `mcap_ros2`."""

import contextlib
import json
import socket
import struct
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.goals import compiled_forward
from pipeline.deployment.messages import (
    Diagnostics,
    EmergencyStop,
    JointState,
    Level,
    MachineCommand,
    Release,
    Reset,
    Status,
    TargetPose,
    Topic,
)
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.transports.simulated_time.delays import no_delays
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.deployment.transports.simulated_time.pace import run_at_real_time
from pipeline.deployment.viewing.live_server import PROTOCOL, LiveServer
from pipeline.deployment.viewing.live_view import LiveView, live_view
from pipeline.deployment.viewing.ros_messages import STORE
from pipeline.errors import InputError
from tests.deployment.machines import MIDDLE, arm, bobcat

PATIENCE_S = 10.0
BEGIN_NS = 1_775_000_000_000_000_000
STEP_NS = nanoseconds(0.02)
FEW = CoverageConfig(cell_m=0.5, pitch_bin_rad=0.5, pitch_max_rad=1.0, samples_per_cell=1)
LARGE = STORE.types["std_msgs/msg/String"](data=200_000 * "x")


class Viewer:
    """What a client of the protocol sees: channels, and the decoded messages of those that it subscribed to."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        assert self.connection.subprotocol == PROTOCOL
        assert self._text()["op"] == "serverInfo"
        advertised = self._text()
        assert advertised["op"] == "advertise"
        self.channels = {channel["topic"]: channel for channel in advertised["channels"]}

    def _text(self) -> dict[str, Any]:
        return json.loads(self.connection.recv(timeout=PATIENCE_S))

    def subscribe(self, *topics: str) -> None:
        wanted = [{"id": 100 + self.channels[t]["id"], "channelId": self.channels[t]["id"]} for t in topics]
        self.connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def unsubscribe(self, topic: str) -> None:
        ended = {"op": "unsubscribe", "subscriptionIds": [100 + self.channels[topic]["id"]]}
        self.connection.send(json.dumps(ended))

    def next(self, timeout_s: float = PATIENCE_S) -> tuple[str, int, Any]:
        """Topic, time (ns) and content of the next message."""
        frame = self.connection.recv(timeout=timeout_s)
        assert isinstance(frame, bytes)
        opcode, subscription, time_ns = struct.unpack_from("<BIQ", frame)
        assert opcode == 1
        (channel,) = [c for c in self.channels.values() if c["id"] == subscription - 100]
        assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
        schema = Schema(1, channel["schema"].encode(), "ros2msg", channel["schemaName"])
        decode = DecoderFactory().decoder_for("cdr", schema)
        assert decode is not None
        return channel["topic"], time_ns, decode(frame[struct.calcsize("<BIQ") :])


@contextlib.contextmanager
def viewer_at(address: str) -> Iterator[Viewer]:
    with connect(address, subprotocols=[PROTOCOL], compression=None, close_timeout=1.0) as connection:
        yield Viewer(connection)


@pytest.fixture
def shown() -> Iterator[tuple[LiveView, str]]:
    """A view, and the address of its server."""
    with live_view(bobcat(), MACHINE_DIRECTORY, FEW, port=0) as (view,):
        assert isinstance(view, LiveView)
        yield view, f"ws://{view._server.place}"


def move(view: LiveView, n_states: int, begin: int = 0) -> None:
    """States 20 ms apart of a machine whose swing turns at 0.5 rad/s under a command."""
    for number in range(begin, begin + n_states):
        time_ns = BEGIN_NS + number * STEP_NS
        q = MIDDLE + np.array([0.01 * number, 0.0, 0.0, 0.0])
        view(Topic.joint_commands, MachineCommand(time_ns, np.array([1.0, 0, 0, -1])), time_ns)
        view(Topic.joint_states, JointState(time_ns, q, 0 * q), time_ns)


def wait_until(view: LiveView, is_wanted: bool) -> None:
    """Until the server has heard that somebody wants a channel, or that nobody does any more."""
    deadline = time.monotonic() + PATIENCE_S
    while any(viewer.subscriptions for viewer in view._server._viewers) is not is_wanted:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_viewer_sees_the_machine_move(shown: tuple[LiveView, str]) -> None:
    view, address = shown
    with viewer_at(address) as viewer:
        viewer.subscribe("/joints")
        wait_until(view, is_wanted=True)
        move(view, 9)
        seen = [viewer.next() for _ in range(3)]  # of 180 ms, at 20 a second
        for (topic, time_ns, joints), number in zip(seen, (1, 4, 7), strict=True):
            assert topic == "/joints" and time_ns == BEGIN_NS + number * STEP_NS
            np.testing.assert_allclose(joints.position, MIDDLE + np.array([0.01 * number, 0, 0, 0]))
            np.testing.assert_allclose(joints.velocity, [0.5, 0, 0, 0], atol=1e-9)
            np.testing.assert_array_equal(joints.effort, [1, 0, 0, -1])
        viewer.unsubscribe("/joints")
        wait_until(view, is_wanted=False)
        move(view, 9, begin=9)
        with pytest.raises(TimeoutError):
            viewer.next(timeout_s=0.2)


def test_whoever_comes_late_is_given_what_stands_and_what_is_newest(shown: tuple[LiveView, str]) -> None:
    view, address = shown
    pose = compiled_forward(arm())(MIDDLE[None].astype(np.float32))
    target = TargetPose(BEGIN_NS, np.array(pose.position[0]), np.array(pose.quaternion[0]))
    view(Topic.target_pose, target, BEGIN_NS)
    view(Topic.emergency_stop, EmergencyStop(BEGIN_NS, "joint_limits", "swing at 1.0 rad"), BEGIN_NS)
    status = Status("control_supervisor", Level.error, "stopped by joint_limits", {})
    view(Topic.diagnostics, Diagnostics(BEGIN_NS, (status,)), BEGIN_NS)
    move(view, 2)
    with viewer_at(address) as viewer:
        viewer.subscribe(*viewer.channels)
        seen = {topic: content for topic, _, content in (viewer.next() for _ in viewer.channels)}
        assert set(seen) == set(viewer.channels)
        assert "<robot" in seen["/robot_description"].data
        moving = {t.child_frame_id for t in seen["/tf"].transforms}
        standing = {t.child_frame_id for t in seen["/tf_static"].transforms}
        assert "boom" in moving and "chisel_tip" in standing and not moving & standing
        assert seen["/target"].pose.position.x == pytest.approx(float(pose.position[0][0]), abs=1e-6)
        assert seen["/events"].msg == "stopped by joint_limits: swing at 1.0 rad"
        assert seen["/diagnostics"].status[0].message == "stopped by joint_limits"


def test_a_stop_and_both_steps_of_its_reset_are_shown(shown: tuple[LiveView, str]) -> None:
    view, address = shown
    with viewer_at(address) as viewer:
        viewer.subscribe("/events")
        wait_until(view, is_wanted=True)
        view(Topic.emergency_stop, EmergencyStop(BEGIN_NS, "joint_limits", "far"), BEGIN_NS)
        view(Topic.reset, Reset(BEGIN_NS + 1, BEGIN_NS), BEGIN_NS + 1)
        view(Topic.release, Release(BEGIN_NS + 2, BEGIN_NS), BEGIN_NS + 2)
        move(view, 2)
        said = [viewer.next()[2].msg for _ in range(3)]
        assert said == ["stopped by joint_limits: far", "the stop was acknowledged", "the stop was reset"]


def test_what_is_painted_and_where_to_go_next_are_told_once_a_second(shown: tuple[LiveView, str]) -> None:
    view, address = shown
    with viewer_at(address) as viewer:
        viewer.subscribe("/painted_share", "/painting")
        wait_until(view, is_wanted=True)
        move(view, 120)  # 2.4 s, over more than one cell
        seen = [viewer.next() for _ in range(6)]
    shares = [content.data for topic, _, content in seen if topic == "/painted_share"]
    texts = [content.data for topic, _, content in seen if topic == "/painting"]
    assert len(shares) == 3 == len(texts) and 0 < shares[0] < shares[2] < 1
    for share, text in zip(shares, texts, strict=True):
        assert f"painted {100 * share:.1f} %" in text and text.count("next: ") == 3
    times = [time_ns for topic, time_ns, _ in seen if topic == "/painted_share"]
    late = np.diff(times) - nanoseconds(1.0)
    assert late.min() >= 0 and late.max() < nanoseconds(0.06)  # with the next picture


def test_a_viewer_that_does_not_read_holds_nobody_up() -> None:
    with contextlib.ExitStack() as afterwards:  # it does not read before the server has ended
        with live_view(bobcat(), MACHINE_DIRECTORY, FEW, port=0) as (view,):
            assert isinstance(view, LiveView)
            server = view._server
            lazy = afterwards.enter_context(viewer_at(f"ws://{server.place}"))
            lazy.subscribe("/robot_description")
            wait_until(view, is_wanted=True)
            publish_until_blocked(server)
            durations_s = []
            for number in range(50):
                begin = time.monotonic()
                server.publish("/robot_description", BEGIN_NS + number, LARGE)
                durations_s.append(time.monotonic() - begin)
            assert np.median(durations_s) < 0.02 and max(durations_s) < 1.0  # on a busy computer
            with viewer_at(f"ws://{server.place}") as prompt:
                prompt.subscribe("/robot_description")
                assert prompt.next()[1] == BEGIN_NS + 49
            begin = time.monotonic()
        assert time.monotonic() - begin < PATIENCE_S


def publish_until_blocked(server: LiveServer) -> None:
    """Until buffers and queue of the only viewer are full, and stay so."""
    (viewer,) = server._viewers
    deadline = time.monotonic() + 3 * PATIENCE_S
    is_blocked = False
    while not is_blocked:
        assert time.monotonic() < deadline
        server.publish("/robot_description", BEGIN_NS, LARGE)
        if viewer._waiting.full():
            time.sleep(0.3)
            is_blocked = viewer._waiting.full()


def test_whoever_says_nothing_does_not_delay_the_end() -> None:
    with live_view(bobcat(), MACHINE_DIRECTORY, FEW, port=0) as (view,):
        assert isinstance(view, LiveView)
        silent = socket.create_connection(view._server._server.socket.getsockname())
        time.sleep(0.1)  # until it is accepted
        begin = time.monotonic()
    assert time.monotonic() - begin < 5.0  # of ten that websockets waits by default
    silent.close()


def test_other_languages_end_their_connection_and_no_other(shown: tuple[LiveView, str]) -> None:
    view, address = shown
    with pytest.raises(InvalidHandshake), connect(address):
        pass
    for text in ("nonsense", "[]", '{"op": "subscribe", "subscriptions": [{"id": "a"}]}'):
        with viewer_at(address) as rude:
            rude.connection.send(text)
            with pytest.raises(ConnectionClosed):
                rude.connection.recv(timeout=PATIENCE_S)
    move(view, 2)
    with viewer_at(address) as polite:
        polite.subscribe("/joints")
        assert polite.next()[0] == "/joints"


def test_a_port_that_is_taken_is_told_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"live_port={port}.*another port"):
            LiveServer(port, None, [])  # type: ignore[arg-type]
    with live_view(bobcat(), MACHINE_DIRECTORY, FEW, None) as taps:
        assert taps == []


def test_simulated_time_can_be_held_to_real_time() -> None:
    graph = SimulatedGraph([], no_delays(), np.random.SeedSequence(0), start_ns=BEGIN_NS)
    begin = time.monotonic()
    run_at_real_time(graph, BEGIN_NS + nanoseconds(0.25))
    assert 0.24 < time.monotonic() - begin < 5.0 and graph.time_ns == BEGIN_NS + nanoseconds(0.25)
