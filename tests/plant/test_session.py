"""The operator paints W+, and the session log is what a bag would hold."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.plant import effects
from pipeline.plant.physics.kinematics import configuration, tip
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import RecordConfig, record_session

DATE = "2024-05-06T09:00:00+00:00"
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def session(machine, nominal):
    return record_session(machine, nominal, draw_style(2), 4.0, 7, START_NS)


def test_log_has_the_rates_of_the_machine(session, machine):
    assert session.commands.shape == (4 * 60 * 20, 4)
    assert session.commands.dtype == np.int8
    assert session.positions.shape == (session.joint_state_header_stamp_ns.size, 4)
    assert session.joint_state_header_stamp_ns.size == pytest.approx(4 * 60 * 50, abs=2)
    assert np.all(session.joint_state_log_time_ns > session.joint_state_header_stamp_ns)
    assert session.joint_state_header_stamp_ns[0] >= START_NS
    assert session.joint_names == machine.joint_names


def test_operator_moves_every_joint_both_ways_alone_and_together(session):
    active = session.commands != 0
    for joint in range(4):
        for direction in (-1, 1):
            assert np.mean(session.commands[:, joint] == direction) > 0.02
        assert np.any(active[:, joint] & (active.sum(axis=1) == 1))
    assert np.mean(active.sum(axis=1) >= 2) > 0.08
    assert np.mean(active.sum(axis=1) == 0) > 0.1


def test_operator_stays_mostly_inside_and_spreads_over_the_workspace(session, machine):
    q = session.true_positions
    (radius, height), pitch = tip(q)[0].T, tip(q)[1]
    w = machine.workspace
    inside = (radius > w.radius_min_m) & (radius < w.radius_max_m) & (np.abs(q[:, 0]) < w.yaw_max_rad)
    inside &= (height > w.z_min_m) & (height < w.z_max_m)
    assert inside.mean() > 0.85
    assert np.ptp(radius) > 0.6 * (w.radius_max_m - w.radius_min_m)
    assert np.ptp(height) > 1.2
    assert np.ptp(q[:, 0]) > w.yaw_max_rad
    assert np.std(pitch) > 0.25


def test_session_is_repeatable_by_seed(machine, nominal):
    one, same, other = (
        record_session(machine, nominal, draw_style(0), 0.3, seed, START_NS) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.positions, same.positions)
    np.testing.assert_array_equal(one.commands, same.commands)
    assert not np.array_equal(one.commands, other.commands)


def test_changed_parameters_hold_from_their_onset_on(machine, nominal):
    effect = effects.draw("sensor_bias", 0, nominal, 1.0)
    changed = [(6.0, effect.apply(nominal))]
    plain = record_session(machine, nominal, draw_style(0), 0.2, 1, START_NS)
    after = record_session(machine, nominal, draw_style(0), 0.2, 1, START_NS, changes=changed)
    early = plain.joint_state_header_stamp_ns < START_NS + 5_900_000_000
    np.testing.assert_array_equal(plain.positions[early], after.positions[early])
    assert not np.array_equal(plain.positions, after.positions)


def test_operator_kinematics_invert(machine):
    random = np.random.default_rng(0)
    found = 0
    for _ in range(200):
        place, pitch = random.uniform([0.9, 0.155], [2.6, 2.5]), random.uniform(-1.0, 1.0)
        q = configuration(place, pitch, 0.2)
        if q is None:
            continue
        found += 1
        reached, reached_pitch = tip(q)
        np.testing.assert_allclose(reached, place, atol=1e-9)
        assert reached_pitch == pytest.approx(pitch)
    assert found > 50


def test_zero_pose_points_outwards():
    """Contract, section 1: at zero angles all links point horizontally outwards; reach 3.05 m, pitch 90°."""
    place, pitch = tip(np.zeros(4))
    np.testing.assert_allclose(place, [0.25 + 1.35 + 0.80 + 0.65, 0.50])
    assert pitch == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    "values",
    [
        ([], 10.0, DATE, 0),
        ([21.0, -1.0], 10.0, DATE, 0),
        ([21.0], 0.0, DATE, 0),
        ([21.0], 1.0, "yesterday", 0),
        ([21.0], 1.0, "2024-05-06T09:00:00", 0),
        ([21.0], 1.0, DATE, -1),
    ],
)
def test_bad_configuration_is_refused(values):
    with pytest.raises(InputError, match="record"):
        RecordConfig(*values)


def test_machine_without_workspace_or_other_rate_is_refused(machine, nominal):
    other = MachineSpecification(name="other", rate_hz=20.0, joints=machine.joints)
    with pytest.raises(InputError, match="workspace"):
        record_session(other, nominal, draw_style(0), 0.1, 0, START_NS)
    other = MachineSpecification(
        name="other", rate_hz=10.0, joints=machine.joints, workspace=machine.workspace
    )
    with pytest.raises(InputError, match="rate_hz"):
        record_session(other, nominal, draw_style(0), 0.1, 0, START_NS)
