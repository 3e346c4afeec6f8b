"""The file for viewers against readers that are not ours: kinematics of Brax, messages decoded by `mcap_ros2`."""

from functools import cache

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.components.goals import compiled_forward
from pipeline.deployment.graph_logs.graph_topics import GraphRecord
from pipeline.deployment.messages import (
    Diagnostics,
    EmergencyStop,
    GoalOutcome,
    Level,
    ReachResult,
    Release,
    Reset,
    Status,
)
from pipeline.deployment.transports.mcap_file import write_mcap_file
from pipeline.deployment.viewing.joint_transforms import joint_transforms
from pipeline.deployment.viewing.ros_messages import STORE
from pipeline.deployment.viewing.visual_topics import visual_topics
from pipeline.logs.messages.raw_log import RawLog, TargetPoses
from pipeline.machine.chain import urdf_path
from pipeline.machine.kinematics import Pose
from tests.deployment.machines import MIDDLE, arm, bobcat

N = 5
BEGIN_NS = 1_775_000_000_000_000_000
Q = (MIDDLE + 0.1 * np.random.default_rng(0).standard_normal((N, 4))).astype(np.float32).astype(float)
TIME_NS = BEGIN_NS + 50_000_000 * np.arange(N)


@cache
def tips() -> Pose:
    return compiled_forward(arm())(Q.astype(np.float32))


def matrices(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    found = np.tile(np.eye(4), (len(position), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(np.roll(quaternion, -1, axis=-1)).as_matrix()
    found[:, :3, 3] = position
    return found


def test_the_chain_of_frames_ends_where_the_kinematics_says() -> None:
    joints = joint_transforms(
        urdf_path(bobcat(), MACHINE_DIRECTORY), dict(zip(bobcat().joint_names, Q.T, strict=True))
    )
    by_child = {joint.child: joint for joint in joints}
    chain, link = np.eye(4), "chisel_tip"
    while link in by_child:
        joint = by_child[link]
        chain, link = matrices(joint.position, joint.quaternion) @ chain, joint.parent
    assert link == "base_link"
    pose = tips()
    np.testing.assert_allclose(chain[:, :3, 3], pose.position, atol=1e-5)
    np.testing.assert_allclose(
        chain, matrices(np.asarray(pose.position), np.asarray(pose.quaternion)), atol=1e-5
    )


@pytest.fixture(scope="module")
def decoded(tmp_path_factory) -> dict[str, list]:
    pose = tips()
    targets = TargetPoses(
        TIME_NS[:1], np.array(pose.position[:1]), np.array(pose.quaternion[:1]), "base_link"
    )
    log = RawLog(
        "bag",
        tmp_path_factory.mktemp("bag"),
        TIME_NS,
        TIME_NS,
        np.asfortranarray(Q),
        TIME_NS[1:3],
        Q[1:3] > 0,
        targets,
    )
    graph = GraphRecord(
        [],
        [(int(TIME_NS[3]), ReachResult(int(TIME_NS[3]), 7, GoalOutcome.stopped, 2))],
        [(int(TIME_NS[2]), EmergencyStop(int(TIME_NS[2]), "joint_limits", "swing at 1.0 rad"))],
        [(int(TIME_NS[3]) + 1, Release(int(TIME_NS[3]) + 1, int(TIME_NS[2])))],
        [(int(TIME_NS[3]), Reset(int(TIME_NS[3]), int(TIME_NS[2])))],
        [(int(TIME_NS[4]), Diagnostics(int(TIME_NS[4]), [Status("plc", Level.warning, "a", {"b": "c"})]))],
    )
    path = log.path / "view/file.mcap"
    write_mcap_file(path, STORE, visual_topics(log, graph, bobcat(), MACHINE_DIRECTORY))
    found: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message, content in reader.iter_decoded_messages():
            assert schema is not None and schema.encoding == "ros2msg"
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def points(cloud) -> np.ndarray:
    assert [field.name for field in cloud.fields] == ["x", "y", "z"] and cloud.header.frame_id == "base_link"
    return np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, 3)


def test_another_reader_finds_the_arm_the_workspace_and_the_target(decoded: dict[str, list]) -> None:
    assert {topic: len(messages) for topic, messages in decoded.items()} == {
        **{"/robot_description": 1, "/tf_static": 1, "/tf": N, "/joints": N},
        **{"/workspace": 1, "/target": 1, "/target_mark": 1, "/events": 5, "/diagnostics": 1},
    }
    assert "<robot" in decoded["/robot_description"][0][1].data
    moving = {transform.child_frame_id for transform in decoded["/tf"][0][1].transforms}
    assert moving == {"swing_column", "boom", "arm", "hammer"}
    fixed = {transform.child_frame_id for transform in decoded["/tf_static"][0][1].transforms}
    assert "chisel_tip" in fixed and not fixed & moving
    workspace, cloud = bobcat().workspace, points(decoded["/workspace"][0][1])
    assert workspace is not None
    radius, yaw = np.hypot(cloud[:, 0], cloud[:, 1]), np.arctan2(cloud[:, 1], cloud[:, 0])
    assert cloud[:, 2].min() == pytest.approx(workspace.z_min_m, abs=1e-6)
    assert cloud[:, 2].max() == pytest.approx(workspace.z_max_m, abs=0.02)  # points are 0.01 m apart
    assert radius.max() == pytest.approx(workspace.radius_max_m, abs=0.01)
    assert np.abs(yaw).max() == pytest.approx(workspace.yaw_max_rad, abs=1e-3)
    mark, tip = (
        points(decoded["/target_mark"][0][1]),
        np.asarray(tips().position[0]),
    )
    assert np.linalg.norm(mark - tip, axis=1).min() < 1e-5
    assert mark[:, 2].mean() > tip[2]  # the chisel comes from above


def test_another_reader_finds_what_was_commanded_and_said(decoded: dict[str, list]) -> None:
    in_force = np.array([state.effort for _, state in decoded["/joints"]])
    np.testing.assert_array_equal(in_force, np.stack([0 * Q[0], *(Q[i] > 0 for i in (1, 2, 2, 2))]))
    np.testing.assert_allclose([state.position for _, state in decoded["/joints"]], Q)
    np.testing.assert_allclose(decoded["/joints"][2][1].velocity, (Q[2] - Q[1]) / 0.05)
    said = [(log_time, line.level, line.name, line.msg) for log_time, line in decoded["/events"]]
    assert [entry[0] for entry in said] == [TIME_NS[0], TIME_NS[2], TIME_NS[3], TIME_NS[3], TIME_NS[3] + 1]
    assert said[1][1:] == (40, "control_supervisor", "stopped by joint_limits: swing at 1.0 rad")
    assert said[2][3] == "goal 7: stopped after 2 ticks"
    assert said[3][1:] == (20, "operator", "the stop was acknowledged")
    assert said[4][1:] == (20, "control_supervisor", "the stop was reset")
    (status,) = decoded["/diagnostics"][0][1].status
    assert (status.name, status.message, status.values[0].key) == ("plc", "a", "b")
    assert status.level in (1, b"\x01")
