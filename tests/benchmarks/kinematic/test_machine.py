"""The kinematic machine without effects: its response, its geometry, its logs and its operators."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.machine import JOINTS, Work, draw_machine
from benchmarks.closed_loop.kinematic.operator import RandomHolds, draw_random_style
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.kinematic.simulator import SUBSTEP_S
from benchmarks.closed_loop.kinematic.speed import read_levers
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from tests.benchmarks.kinematic.scripted_machine import (
    ARM,
    BUCKET,
    DT_S,
    FULL_RAD_S,
    QUIET,
    SWING,
    driven,
    held,
    plant_levers,
    speeds,
)


def test_a_sound_machine_moves_at_full_speed_after_its_dead_time():
    log = driven(QUIET, held((0, 1.0), (1, 1.0), (0, 0.5)))
    moved = log.true_positions[-1] - log.true_positions[0]
    np.testing.assert_allclose(moved, [FULL_RAD_S * 1.0, 0, 0, 0], atol=1e-9)
    still = round((1.0 + 0.1) / DT_S)
    assert np.all(speeds(log, SWING)[: still - 1] == 0.0)
    assert speeds(log, SWING)[still] == pytest.approx(FULL_RAD_S)


def test_the_response_is_of_first_order_with_a_constant_of_its_own_each_way():
    rise_s, fall_s = np.full(4, 0.3), np.full(4, 0.1)
    machine = QUIET.change("motion", rise_time_constant_s=rise_s, fall_time_constant_s=fall_s)
    log = driven(machine, held((1, 1.2), (0, 1.0), joint=BUCKET))
    way = log.true_positions[:, BUCKET] - log.true_positions[0, BUCKET]
    t = DT_S * (1.0 + np.arange(24)) - 0.1  # since the command arrived
    expected = FULL_RAD_S * (t - 0.3 * (1.0 - np.exp(-t / 0.3)))
    np.testing.assert_allclose(way[2:24], expected[2:], atol=FULL_RAD_S * SUBSTEP_S)
    reached = 1.0 - math.exp(-1.2 / 0.3)
    total = FULL_RAD_S * (1.2 - 0.3 * reached + 0.1 * reached)
    assert way[-1] == pytest.approx(total, abs=FULL_RAD_S * SUBSTEP_S)


def test_more_joints_than_the_supply_feeds_share_it():
    machine = QUIET.change("speed", capacity=2.0)
    log = driven(machine, np.ones((10, 4), dtype=np.int8))
    assert speeds(log, ARM)[6] == pytest.approx(FULL_RAD_S * 2.0 / 4.0)


def test_levers_are_those_of_the_tip():
    for q in np.random.default_rng(0).uniform(specification().lower, specification().upper, (20, 4)):
        levers = np.empty(4)
        read_levers(q, levers)
        np.testing.assert_allclose(levers, plant_levers(q), atol=1e-12)


def test_stops_hold_and_let_go():
    commands = held((1, 8.0), (-1, 0.5), joint=BUCKET)
    for machine in (QUIET, draw_machine(specification(), 0, 1)):
        position = driven(machine, commands).true_positions[:, BUCKET]
        assert position.max() == specification().upper[BUCKET] == position[158]
        assert position[-1] < position[158] - 0.05


def test_a_session_follows_from_its_seed():
    of = variant(KINEMATIC, 8)
    first, again, other = (
        record_session(specification(), of.parameters, of.style_seed, 0.5, seed, 0) for seed in (1, 1, 2)
    )
    for name in ("positions", "commands", "joint_state_header_stamp_ns", "command_log_time_ns"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.commands, other.commands)


def test_a_log_is_like_the_plants():
    of = variant(KINEMATIC, 9)
    start_ns = 1_700_000_000 * 10**9
    log = record_session(specification(), of.parameters, of.style_seed, 0.5, 3, start_ns)
    assert log.joint_names == JOINTS
    assert log.commands.shape == log.true_positions.shape == (600, 4)
    assert log.commands.dtype == np.int8
    assert len(log.positions) == len(log.joint_state_log_time_ns) == pytest.approx(30.0 / 0.02, abs=2)
    assert np.all(np.diff(log.joint_state_header_stamp_ns) > 0)
    assert np.all(log.joint_state_log_time_ns > log.joint_state_header_stamp_ns)
    assert start_ns < log.command_log_time_ns[0] < start_ns + 10**7
    encoder = of.parameters.quantities.encoder
    ends_ns = start_ns + np.round(5e7 * (1 + np.arange(600)))
    within = log.joint_state_header_stamp_ns > ends_ns[0]
    true = np.interp(log.joint_state_header_stamp_ns[within], ends_ns, log.true_positions[:, BUCKET])
    assert np.std(log.positions[within, BUCKET] - true) < 5.0 * encoder.noise_std_rad


def test_speeds_and_responses_are_those_of_the_class():
    for number in range(8):
        machine = variant(KINEMATIC, number).parameters
        speed = machine.quantities.speed.full_speed_rad_s
        assert speed.min() > 0.25 and speed.max() < 0.76  # contract, section 1: 0.25 to 0.7, and one tenth
        to_90_percent_s = machine.quantities.command_path.dead_time_s + math.log(10.0) * (
            machine.quantities.motion.rise_time_constant_s
        )
        assert to_90_percent_s.min() > 0.3 and to_90_percent_s.max() < 1.0
    assert {variant(KINEMATIC, number).parameters.work for number in range(8)} == set(Work)


def test_random_holds_stay_in_the_middle_and_have_pauses():
    at_sticks = RandomHolds(specification(), draw_random_style(1), 2)
    low = np.array([at_sticks.command(specification().lower) for _ in range(4000)])
    assert (low[low != 0] == 1).mean() > 0.9
    assert 0.2 < (low == 0).mean() < 0.95


def test_nothing_of_the_plant_but_its_operator_and_its_means_is_used():
    allowed = {"recording.operator", "compiled", "records", "recording.session"}
    folder = Path(effects.__file__).parents[1]
    modules = {
        node.module
        for path in folder.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module.startswith("pipeline.")
    }
    plant = {m.removeprefix("pipeline.plant.") for m in modules if m.startswith("pipeline.plant")}
    assert plant == allowed
    rest = {module for module in modules if not module.startswith("pipeline.plant")}
    assert rest <= {"pipeline.errors", "pipeline.machine.specification"}
