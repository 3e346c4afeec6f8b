"""Drawn machines: every constant is drawn, by seed alone, and they move as the contract says; replays of sessions."""

import numpy as np
import pytest

from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine
from benchmarks.closed_loop.simulators import KINEMATIC, PLANT, SIMULATORS
from benchmarks.machine_draws.hydraulic import draw_hydraulic, walther
from benchmarks.machine_draws.kinematic import draw_kinematic
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.machines.characterise import full_speed, rise_time
from tests.benchmarks.kinematic.scripted_machine import QUIET

SEED = 17
# What a draw leaves: the description's geometry, cylinders and cab, the simulation's steps, what only effects change,
# and what is not of the machine.
LEFT = {
    "pilot": {
        "crosstalk",
        "coil_fade",
        "coil_time_constant_s",
        "supply_sag",
        "supply_time_constant_s",
        "late_interval_s",
        "late_s",
    },
    "spool": set(),
    "supply": {"engine_power_W", "relief_wander_std", "others_share", "others_interval_s", "others_s"},
    "cylinder": {
        "area_m2",
        "line_clogging_per_m3",
        "kink_source",
        "kink_onset_rad",
        "kink_side",
        "kink_resistance_Pa_s_m3_rad",
    },
    "linkage": {"lower_rad", "upper_rad", "moment_arm_m", "travel_m"},
    "links": {"length_m", "pivot_radius_m", "payload_kg", "gravity_m_s2"},
    "contact": {"floor_m", "pivot_height_m", "base_radius_m", "base_height_m"},
    "friction": set(),
    "oil": {"reference_viscosity_Pa_s"},
    "sensor": {
        "offset_rad",
        "scale",
        "period_s",
        "stamp_lateness_s",
        "publication_delay_s",
        "mount_flex_rad",
    },
    "numerics": {"substep_s", "control_period_s", "trace_stride"},
}


def same(one, other):
    return {
        part: {name for name in values._fields if np.array_equal(getattr(values, name), getattr(again, name))}
        for part, values, again in zip(one._fields, one, other, strict=True)
    }


@pytest.fixture(scope="module")
def drawn():
    return draw_hydraulic(bobcat_e10(), SEED)


def test_every_constant_of_the_plant_is_drawn(drawn):
    kept = same(drawn, bobcat_e10())
    kept["sensor"].discard("quantum_rad")  # one of three, that of the nominal machine among them
    kept["oil"] -= {"walther_a", "walther_b"}  # likewise
    assert kept == LEFT


def test_a_seed_is_a_machine(drawn):
    again = same(drawn, draw_hydraulic(bobcat_e10(), SEED))
    assert all(names == set(getattr(drawn, part)._fields) for part, names in again.items())
    assert same(drawn, draw_hydraulic(bobcat_e10(), SEED + 1)) != again
    one, other, third = (draw_kinematic(machine(), seed).quantities for seed in (SEED, SEED, SEED + 1))
    assert one.speed.capacity == other.speed.capacity != third.speed.capacity
    np.testing.assert_array_equal(one.speed.full_speed_rad_s, other.speed.full_speed_rad_s)


def test_drawn_machines_move_as_the_contract_says(drawn):
    for joint, direction in ((0, 1), (3, -1)):
        assert 0.25 <= full_speed(drawn, joint, direction) <= 0.7
        assert 0.4 <= rise_time(drawn, joint, direction) <= 1.0
    speeds = np.array(
        [draw_kinematic(machine(), seed).quantities.speed.full_speed_rad_s for seed in range(40)]
    )
    assert 0.25 <= speeds.min() < 0.3 and 0.6 < speeds.max() <= 0.7


def test_oil_has_the_viscosities_of_its_grade():
    a, b = walther(46.0, 6.8)
    for celsius, viscosity in ((40.0, 46.0), (100.0, 6.8)):
        assert 10.0**10.0 ** (a - b * np.log10(celsius + 273.15)) - 0.7 == pytest.approx(viscosity)


def test_numbers_are_drawn_machines():
    for simulator in SIMULATORS.values():
        one, other = (variant(simulator, number) for number in (8, 9))
        assert one.style_seed != other.style_seed
        assert one.parameters is not other.parameters


def without_chances():
    parameters = bobcat_e10().change("pilot", noise_std=0.0, controller_cycle_s=0.001)
    parameters = parameters.change("supply", ripple_std=0.0)
    return parameters.change("spool", silt_spread=0.0).change("sensor", command_jitter_s=0.0)


WITHIN_SUBSTEPS = QUIET.change("command_path", dead_time_s=np.full(4, 0.101))  # no rounding to either side


@pytest.mark.parametrize(
    ("simulator", "sound", "tolerance_rad"),
    [(PLANT, without_chances(), 1e-12), (KINEMATIC, WITHIN_SUBSTEPS, 1e-9)],
    ids=["plant", "kinematic"],
)
def test_a_replay_without_chances_is_the_session(simulator, sound, tolerance_rad):
    log = simulator.record(sound, (), 3, 0.5, 4, 0)
    starts, horizon = [100, 250, 400], 120
    [again] = simulator.replay(sound, log, 4, starts, horizon, 5)
    path = log.true_positions
    first = np.array([path[start : start + horizon] - path[start - 1] for start in starts])
    assert np.abs(first).max() > 0.1
    np.testing.assert_allclose(again, first, atol=tolerance_rad)


@pytest.mark.parametrize("simulator", SIMULATORS.values(), ids=lambda s: s.name)
def test_replays_differ_by_their_chances_and_by_what_takes_the_machines_place(simulator):
    of = variant(simulator, 8)
    sound = of.parameters
    log = simulator.record(sound, (), 3, 0.5, 4, 0)
    arguments = (sound, log, 4, [100, 300], 80)
    one, other = simulator.replay(*arguments, 5, instead=(None, None))
    np.testing.assert_array_equal(simulator.replay(*arguments, 5, instead=(sound,))[0], one)
    assert 1e-4 < np.abs(one - other)[:, -1].max() < 0.1
    slow = simulator.draw_effect("delay", 1, of, 2.0).apply(sound)
    [late] = simulator.replay(*arguments, 5, instead=(slow,))
    assert np.abs(late - one).max() > 2.0 * np.abs(one - other).max()
