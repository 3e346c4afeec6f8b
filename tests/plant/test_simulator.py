"""What the contract says of the machine, limits, determinism and process variation."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.plant.machines.characterise import full_speed, respond, rise_time, sag_rate
from pipeline.plant.simulator import Plant

from .conftest import MIDDLE, random_commands

JOINTS_AND_DIRECTIONS = [(joint, direction) for joint in range(4) for direction in (-1, 1)]


@pytest.mark.parametrize(("joint", "direction"), JOINTS_AND_DIRECTIONS)
def test_rise_time_and_full_speed_are_the_contracts(nominal, joint, direction):
    assert 0.4 <= rise_time(nominal, joint, direction) <= 1.0
    response = respond(nominal, joint, direction, 3.0)
    inside = (response.angle_rad > nominal.linkage.lower_rad[joint] + 0.1) & (
        response.angle_rad < nominal.linkage.upper_rad[joint] - 0.1
    )
    speed = direction * response.speed_rad_s[inside & (response.time_s > 1.0)]
    assert speed.min() >= 0.25
    assert speed.max() <= 0.7


@pytest.mark.parametrize(("joint", "direction"), JOINTS_AND_DIRECTIONS)
def test_command_sign_moves_the_joint_that_way(nominal, joint, direction):
    response = respond(nominal, joint, direction, 1.5)
    assert direction * (response.angle_rad[-1] - response.angle_rad[0]) > 0.2


def test_limits_are_never_left_beyond_the_stops_compliance(nominal):
    plant = Plant(nominal, 5, MIDDLE)
    sample = plant.run(random_commands(5, 60, 60))
    compliance = 2.0e-3  # one substep at full speed, and the pin clearance
    assert np.all(sample.angle_rad > nominal.linkage.lower_rad - compliance)
    assert np.all(sample.angle_rad < nominal.linkage.upper_rad + compliance)
    reached = (sample.angle_rad.max(0) > nominal.linkage.upper_rad - 0.01) | (
        sample.angle_rad.min(0) < nominal.linkage.lower_rad + 0.01
    )
    assert reached.all()  # the test did drive into the stops
    assert np.all(plant.state.chamber_Pa > -1.1e5)  # no absolute pressure below zero


def test_same_seed_same_motion_however_the_calls_are_divided(nominal):
    commands = random_commands(0, 12, 7)
    whole = Plant(nominal, 11, MIDDLE).run(commands)
    plant = Plant(nominal, 11, MIDDLE)
    parts = [plant.run(part) for part in (commands[:1], commands[1:4], commands[4:30], commands[30:])]
    np.testing.assert_array_equal(whole.angle_rad, np.concatenate([part.angle_rad for part in parts]))
    np.testing.assert_array_equal(whole.command_log_s, np.concatenate([part.command_log_s for part in parts]))
    for field in ("stamp_s", "log_s", "position_rad"):
        divided = np.concatenate([getattr(part.joint_states, field) for part in parts])
        np.testing.assert_allclose(getattr(whole.joint_states, field), divided, atol=1e-12)


def test_other_seed_other_motion(nominal):
    commands = random_commands(0, 12, 7)
    one, other = (Plant(nominal, seed, MIDDLE).run(commands).angle_rad for seed in (1, 2))
    assert not np.array_equal(one, other)


def test_activations_do_not_repeat_exactly_but_nearly(nominal):
    """The same tap, twelve times from rest: travel varies by some per cent."""
    plant = Plant(nominal, 0, MIDDLE)
    travels = []
    for _ in range(12):
        tap = np.zeros((80, 4))
        tap[:14, 0] = 1.0
        tap[40:54, 0] = -1.0
        angle = plant.run(tap).angle_rad[:, 0]
        travels.append(angle[39] - angle[0])
    variation = np.std(travels) / np.mean(travels)
    assert 0.002 < variation < 0.15


def test_gravity_makes_the_boom_slower_up_than_down_and_a_payload_more_so(nominal):
    heavy = nominal.change("links", payload_kg=60.0)
    assert full_speed(nominal, 1, 1) < full_speed(nominal, 1, -1)
    assert full_speed(heavy, 1, 1) < full_speed(nominal, 1, 1)
    assert full_speed(heavy, 1, -1) > full_speed(nominal, 1, -1)
    weightless = nominal.change("links", gravity_m_s2=0.0)
    assert full_speed(weightless, 1, 1) > full_speed(nominal, 1, 1)


def test_simultaneous_motions_share_the_pump(nominal):
    for joint in range(4):
        assert full_speed(nominal, joint, 1, others=np.ones(4)) < 0.95 * full_speed(nominal, joint, 1)


def test_the_arm_holds_still_at_zero_command(nominal):
    for joint in range(4):
        assert abs(sag_rate(nominal, joint)) < 5e-4


def test_cold_oil_is_slower_and_warms_up(nominal):
    cold = nominal.change("oil", start_C=5.0)
    assert full_speed(cold, 1, 1) < 0.9 * full_speed(nominal, 1, 1)
    plant = Plant(cold, 0, MIDDLE)
    plant.run(random_commands(0, 240, 20))
    assert 10.0 < plant.state.oil_C[0] < 45.0


def test_viscosity_is_that_of_iso_vg_46(nominal):
    """46 and 6.8 mm²/s at 40 and 100 °C, the values that define the grade and its usual index."""
    from pipeline.plant.physics.oil import dynamic_viscosity

    density = nominal.oil.density_kg_m3
    assert dynamic_viscosity(nominal.oil, 40.0) / density == pytest.approx(46e-6, rel=0.02)
    assert dynamic_viscosity(nominal.oil, 100.0) / density == pytest.approx(6.8e-6, rel=0.02)


@pytest.mark.parametrize("commands", [np.full((3, 4), 2), np.zeros((3, 3)), np.full((2, 4), np.nan)])
def test_bad_commands_are_refused(nominal, commands):
    with pytest.raises(InputError, match="commands"):
        Plant(nominal, 0, MIDDLE).run(commands)


def test_start_outside_the_stops_is_refused(nominal):
    with pytest.raises(InputError, match="outside the stops"):
        Plant(nominal, 0, np.array([0.0, 2.0, -1.0, 0.0]))
