"""Messages survive ROS's wire format."""

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest

from pipeline.deployment import messages as m
from pipeline.deployment.messages import Topic
from pipeline.deployment.transports.ros1.agreement import COMPARED, agreement_table, paired_differences
from pipeline.deployment.transports.ros1.definitions import action_messages, generate, own_types
from pipeline.deployment.transports.ros1.installation import DEBIAN_PACKAGES, require_ros
from pipeline.deployment.transports.ros1.measurements import distributions, real_time_table
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.errors import InputError
from tests.deployment.machines import bobcat
from tests.ros_graph import DIST_PACKAGES, requires_debian

PACKAGES = {
    "python3-rospy": DIST_PACKAGES / "rospy",
    "python3-actionlib": DIST_PACKAGES / "actionlib",
    "python3-sensor-msgs": DIST_PACKAGES / "sensor_msgs",
}
NOW = 1_700_000_000_123_456_789
EXAMPLES = {
    Topic.joint_states: m.JointState(NOW, np.array([0.1, 0.2, -1.0, -0.3]), np.array([0.0, 1.0, 2.0, -3.0])),
    Topic.joystick: m.Joystick(NOW, np.array([0.5, -1.0, 0.0])),
    Topic.target_pose: m.TargetPose(NOW, np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.0, 0.8, 0.0])),
    Topic.requested_commands: m.JointCommand(
        NOW, "server", 5, NOW - 10**7, np.array([1.0, 0.0, -1.0, 0.0]), True
    ),
    Topic.joint_commands: m.MachineCommand(NOW, np.array([-1.0, 0.0, 1.0, 1.0])),
    Topic.emergency_stop: m.EmergencyStop(NOW, "joint_limits", "swing at 1.0 rad"),
    Topic.machine_outputs: m.MachineOutputs(NOW, np.array([0.0, 1.0, -1.0, 0.0])),
    Topic.can_to_machine: m.CanFrame(NOW, 0x201, b"\x01\x02\x03"),
    Topic.can_from_machine: m.CanFrame(NOW, 0x301, bytes(range(8))),
    Topic.supervisor_state: m.SupervisorState(NOW, "joint_limits", NOW - 1),
    Topic.reset: m.Reset(NOW, NOW - 1),
    Topic.release: m.Release(NOW, NOW - 1),
    Topic.diagnostics: m.Diagnostics(
        NOW, (m.Status("plc", m.Level.error, "stopped", {"ticks, Hz": "99.8"}),)
    ),
}


@requires_debian(PACKAGES)
@pytest.mark.parametrize("topic", EXAMPLES)
def test_a_message_comes_back_as_it_was(topic: Topic) -> None:
    carrier = carriers(bobcat())[topic]
    stream = io.BytesIO()
    carrier.to_ros(EXAMPLES[topic]).serialize(stream)
    back = carrier.from_ros(carrier.ros_type().deserialize(stream.getvalue()), NOW)
    for field in dataclasses.fields(back):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(EXAMPLES[topic], field.name))


@requires_debian(PACKAGES)
def test_every_topic_between_processes_is_carried_by_the_machines_names() -> None:
    table = carriers(bobcat())
    assert set(table) == set(EXAMPLES) == set(Topic) - {Topic.goal, Topic.cancel, Topic.result}  # an action
    assert (
        table[Topic.joint_states].name == "/joint_states" and table[Topic.target_pose].name == "/target_pose"
    )


@requires_debian(PACKAGES)
def test_generated_types_are_those_that_the_message_compilers_make() -> None:
    """By their check sums, which two nodes compare before they talk: of actionlib's own example, and of CAN frames."""
    require_ros()
    import actionlib.msg as compiled

    text = "int32 goal\n---\nint32 result\n---\nint32 feedback\n"
    generated = generate(action_messages("actionlib/Test", text))
    assert len(generated) == 7
    for name, ros_type in generated.items():
        assert ros_type._md5sum == getattr(compiled, name.split("/")[1])._md5sum
    assert own_types()["diagnostic_msgs/DiagnosticArray"]._md5sum == "60810da900de1dd6ddd437c3503511da"
    assert own_types()["can_msgs/Frame"]._md5sum == "64ae5cebf967dc6aae4e78f5683a5b25"  # as released


def test_without_ros_one_line_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setattr(
        "pipeline.deployment.transports.ros1.installation.ROSMASTER", Path("/no/such/rosmaster")
    )
    with pytest.raises(InputError, match="apt-get install"):
        require_ros()
    assert DEBIAN_PACKAGES == DIST_PACKAGES


def test_measurements_become_distributions_and_a_table() -> None:
    ramp = [1.0] * 40 + list(np.linspace(0.001, 0.002, 1001))  # the first forty are the warm-up
    quantities = (
        "age joint_states",
        "age requested_commands",
        "computation DecisionRequest",
        "timer",
        "tick",
    )
    node = dict.fromkeys(quantities, ramp)
    measured = {
        "autonomous_server": {**node, "missed": [0.1]},
        "control_interface": node,
        "bobcat_e10_sim_driver": node,
    }
    links = distributions(measured)
    assert links["inference"].quantiles_s[[0, 100, 200]] == pytest.approx([0.001, 0.0015, 0.002])
    slow = {**measured, "autonomous_server": {**node, "computation DecisionRequest": [0.1] * 60 + [0.3] * 5}}
    assert set(distributions(measured, slow)) - set(links) == {"planning"}
    assert distributions(measured, slow)["planning"].quantiles_s[[0, 200]] == pytest.approx([0.1, 0.3])
    table = real_time_table({"PPO": measured, "iCEM": slow}, decision_s=0.2)
    assert "| inference, from request to command | 1.50 | 2.00 | 1001 | 100.00 | 300.00 | 25 |" in table
    assert "| missed ticks of autonomous_server | 1 of 1042 | | | 0 of 1041 | | |" in table
    assert "| decisions later than the next one is due (200 ms) | 0 of 1001 | | | 5 of 25 | | |" in table
    with pytest.raises(InputError, match="run for longer"):
        distributions({**measured, "control_interface": {}})


def test_pairs_are_compared_by_their_differences() -> None:
    def trial(number: int, error_m: float) -> dict:
        values = dict.fromkeys(COMPARED, 0.5)
        return {**values, "final_position_error_m": error_m, "target_position_m": [1.0, number, 0.5]}

    real = [trial(0, 0.02), trial(1, 0.05), trial(2, 0.09)]
    simulated = [trial(0, 0.01), trial(1, 0.03), trial(2, 0.06)]
    found = paired_differences(real, simulated)["distance at the end, m"]
    # differences 0.01, 0.02, 0.03: mean 0.02, standard deviation 0.01; t(0.975, 2) = 4.303 (tables)
    assert found.difference == pytest.approx(0.02)
    assert found.half_width == pytest.approx(4.303 * 0.01 / np.sqrt(3), rel=1e-3)
    assert found.contains_zero and found.n == 3
    assert "| distance at the end, m | 0.053 | 0.033 | +0.020 ± 0.025 |" in agreement_table(
        paired_differences(real, simulated)
    )
    sure = paired_differences(
        real, [trial(n, row["final_position_error_m"] - 0.02) for n, row in enumerate(real)]
    )
    assert not sure["distance at the end, m"].contains_zero and sure["OOW"].contains_zero
    assert sure["OOW"].half_width == 1.0  # three pairs without a difference tell nothing of a rate
    assert paired_differences(real[:1], simulated[:1])["OOW"].half_width == np.inf
    with pytest.raises(InputError, match="not of the same targets"):
        paired_differences(real, simulated[::-1])
