"""The machine in the field, and the workshop's, which stays as it was."""

import hashlib

import numpy as np
import pytest

from pipeline.plant.machines.characterise import full_speed, start_time
from pipeline.plant.machines.field import Shift, draw_shift, in_the_field
from pipeline.plant.machines.simulated import Condition, simulated_machine
from pipeline.plant.physics.sensor import follow
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import record_session
from pipeline.plant.simulator import Plant
from pipeline.plant.state import OTHERS
from pipeline.testbench.plant_machine import ChangedPlant

from .conftest import MIDDLE

START_NS = 1_700_000_000_000_000_000
PUBLISHED_LOSS = 5.6e-3  # rad², the paper's selected models at H = 80
PUBLISHED_DELAY_S = 1.0  # the paper's longest from command to motion
SWING_LEFT = np.tile([1, 0, 0, 0], (40, 1))


@pytest.fixture(scope="module")
def field():
    return simulated_machine("bobcat_e10", Condition.field)


def test_recordings_of_the_workshop_are_what_they_were(machine, nominal):
    """Counts and commands as recorded before there was a field; not times, whose last bits a platform may change."""
    log = record_session(machine, nominal, draw_style(2), 0.5, 7, START_NS)
    counts = np.round(log.positions / nominal.sensor.quantum_rad).astype(np.int32)
    assert (
        hashlib.sha256(counts.tobytes() + log.commands.tobytes()).hexdigest().startswith("a9d09f7a17afa439")
    )


def test_delay_from_command_to_motion_is_short_warm_and_up_to_the_published_one_cold(field):
    def delays(shift):
        return [start_time(shift.started(field, 1), joint, 1, rest_s=5.0) for joint in range(4)]

    shifts = [Shift((), seed) for seed in range(12)]
    by_warmth = sorted(shifts, key=lambda shift: shift.started(field, 1).oil.start_C)
    assert 0.7 * PUBLISHED_DELAY_S < max(delays(by_warmth[0])) <= PUBLISHED_DELAY_S
    assert max(delays(by_warmth[-1])) < 0.7 * PUBLISHED_DELAY_S


def test_what_the_sensors_add_is_less_than_a_tenth_of_the_published_loss(field):
    """Variances of uniform errors of a count and of the mounts' band, and of noise, of four joints."""
    sensor = field.sensor
    of_joint = (sensor.quantum_rad**2 + sensor.mount_flex_rad**2) / 12.0 + sensor.noise_std_rad**2
    assert of_joint.sum() < 0.1 * PUBLISHED_LOSS


def test_other_functions_slow_the_arm_as_a_smaller_pump_does(nominal):
    supply = nominal.supply
    shared = nominal.change("supply", others_share=0.4, others_interval_s=1e-9, others_s=1e9)
    small = nominal.change("supply", pump_flow_m3_s=0.6 * supply.pump_flow_m3_s)
    speed, as_small, alone = (full_speed(p, 0, 1) for p in (shared, small, nominal))
    assert speed == pytest.approx(as_small, rel=0.05)  # but for the engine, which drives the others too
    assert speed < 0.8 * alone


def test_other_functions_run_for_their_share_of_the_time(nominal):
    plant = Plant(nominal.change("supply", others_share=0.4, others_interval_s=3.0, others_s=1.0), 1, MIDDLE)
    on = []
    for _ in range(6000):
        plant.step(np.zeros(4))
        on.append(int(plant.state.switches[OTHERS]))
    assert np.mean(on) == pytest.approx(0.25, abs=0.04)
    assert np.sum(np.diff(on) == 1) == pytest.approx(300.0 / 4.0, rel=0.3)


def test_late_commands_let_the_controller_repeat_the_last_one(nominal):
    late = nominal.change("pilot", late_interval_s=1e-9, late_s=1e9)
    plant, prompt = Plant(late, 0, MIDDLE), Plant(nominal, 0, MIDDLE)
    np.testing.assert_allclose(plant.run(SWING_LEFT).angle_rad[-1, 0], MIDDLE[0], atol=1e-3)
    prompt.run(SWING_LEFT)
    prompt.change(late)
    before = prompt.state.link_angle_rad[0]
    assert prompt.run(np.zeros((20, 4))).angle_rad[-1, 0] > before + 0.2  # the zero does not come through


def test_a_flexing_mount_lags_by_half_its_band_on_either_way():
    way = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])[:, None]
    followed = follow(way, np.zeros(1), np.array([0.1]))
    assert followed[100, 0] == pytest.approx(0.95) and followed[-1, 0] == pytest.approx(0.05)
    np.testing.assert_array_equal(follow(way, np.zeros(1), np.zeros(1)), way)


def test_oil_cools_while_the_engine_is_off_and_the_arm_stays(nominal):
    plant = Plant(nominal, 0, MIDDLE)
    oil, before = nominal.oil, plant.state.link_angle_rad.copy()
    plant.stop_engine(oil.heat_capacity_J_K / oil.heat_loss_W_K)  # one time constant
    assert (plant.state.oil_C[0] - oil.ambient_C) / (oil.start_C - oil.ambient_C) == pytest.approx(
        np.exp(-1.0)
    )
    np.testing.assert_array_equal(plant.state.link_angle_rad, before)
    assert plant.time_s == 0.0


def test_a_log_has_a_gap_where_the_engine_was_off(machine, field):
    shift = Shift(((6.0, 100.0), (12.0, 50.0)), 3)
    log = record_session(machine, field, draw_style(0), 0.4, 1, START_NS, shift=shift)
    for times in (log.joint_state_header_stamp_ns, log.joint_state_log_time_ns, log.command_log_time_ns):
        steps = np.diff(times) / 1e9
        assert (steps > 0).all()
        np.testing.assert_allclose(steps[steps > 1.0], [100.0, 50.0], atol=0.2)
    gap = np.flatnonzero(np.diff(log.joint_state_header_stamp_ns) > 1e9)
    assert np.abs(log.positions[gap + 1] - log.positions[gap]).max() < 0.01
    pressure_ns, _ = log.channels["pump_pressure"]
    assert (np.diff(pressure_ns) > 1e9).sum() == 2


def test_starts_differ_and_are_repeatable_by_seed(field):
    one, same, other = (draw_shift(seed, 1800.0) for seed in (1, 1, 2))
    assert one == same != other
    assert all(0.0 < at < 1800.0 for at, _ in one.pauses) and one.pauses
    first, second = (one.started(field, n).pilot.dead_time_s for n in (1, 2))
    assert not np.allclose(first, second)
    assert (first >= field.pilot.dead_time_s).all()
    np.testing.assert_array_equal(first, same.started(field, 1).pilot.dead_time_s)


def test_a_machine_in_the_field_differs_from_the_workshops(nominal, field):
    assert in_the_field(nominal).supply == field.supply
    assert simulated_machine("bobcat_e10").supply == nominal.supply


def test_the_deployed_plant_starts_anew_per_session_in_the_field_and_is_nominal_in_the_workshop(
    nominal, field
):
    def of(condition, session):
        return ChangedPlant(
            start_time="2026-04-01T09:00:00+00:00",
            plant_seed=1,
            effects_seed=0,
            effect_size=1.0,
            condition=condition,
        ).parameters("bobcat_e10", session)

    for session in (0, 2):
        deployed, started = of(Condition.field, session), Shift((), 1 + session).started(field, 1)
        assert deployed.supply == field.supply and deployed.oil.start_C == started.oil.start_C
        np.testing.assert_array_equal(deployed.pilot.dead_time_s, started.pilot.dead_time_s)
        assert of(Condition.workshop, session).oil.start_C == nominal.oil.start_C
