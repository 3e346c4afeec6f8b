"""Effects on speed against closed forms, in the truth's numbers."""

import math

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.machine import JOINTS
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from tests.benchmarks.kinematic.scripted_machine import (
    ARM,
    BACK_AND_FORTH,
    BOOM,
    BUCKET,
    DT_S,
    FULL_RAD_S,
    QUIET,
    SWING,
    drawn_effect,
    driven,
    held,
    moving_ratio,
    on_joint,
    plant_levers,
    speeds,
    value,
)


@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_gain_is_the_ratio_of_steady_speeds(direction):
    effect = drawn_effect("gain", where=lambda e: value(e, "direction") == direction)
    joint = JOINTS.index(effect.joints[0])
    log = driven(effect.apply(QUIET), held((1, 0.5), (-1, 0.5), (0, 0.2), joint=joint))
    for sign, row in ((1, 6), (-1, 16)):
        ratio = value(effect, "speed_ratio") if direction in (0, sign) else 1.0
        assert speeds(log, joint)[row] == pytest.approx(sign * FULL_RAD_S * ratio)


def test_flow_coupling_takes_its_share_while_others_move():
    effect = drawn_effect("flow_coupling")
    for n_other in range(4):
        commands = np.zeros((12, 4), dtype=np.int8)
        commands[:, : n_other + 1] = 1
        expected = FULL_RAD_S * (1.0 - value(effect, "loss_fraction") * n_other / 3.0)
        assert speeds(driven(effect.apply(QUIET), commands), SWING)[8] == pytest.approx(expected)
    assert effect.joints == JOINTS


def test_load_slows_lifting_and_hastens_lowering_and_states_the_mean_over_nominal_poses():
    of = variant(KINEMATIC, 8)
    effect = effects.draw("load", 5, of, 1.0)
    assert effect.joints == ("boom", "arm")
    loss = effect.apply(QUIET).quantities.speed.load_loss
    log = driven(effect.apply(QUIET), held((1, 0.3), (-1, 0.3), (0, 0.1), joint=BOOM))
    for sign, row in ((1, 4), (-1, 10)):
        lever = plant_levers(log.true_positions[row])[BOOM]
        assert speeds(log, BOOM)[row] == pytest.approx(
            sign * FULL_RAD_S * (1.0 - sign * loss[BOOM] * lever), rel=0.02
        )
    nominal = [KINEMATIC.record(of.parameters, (), of.style_seed, 12.0, seed, 0) for seed in of.session_seeds]
    for joint in (BOOM, ARM):
        for name, sign in (("up", 1), ("down", -1)):
            levers = [
                plant_levers(q)[joint]
                for log in nominal
                for q, a in zip(log.true_positions[::20], log.commands[::20], strict=True)
                if a[joint] == sign
            ]
            told = value(effect, f"mean_speed_ratio_{name}:{JOINTS[joint]}")
            assert told == pytest.approx(1.0 - sign * loss[joint] * np.mean(levers), abs=0.01)
    both = [value(effect, f"mean_speed_ratio_up:{name}") for name in effect.joints]
    assert value(effect, "mean_speed_ratio_up") == pytest.approx(np.mean(both))


def test_cold_oil_warms_up_exponentially():
    effect = drawn_effect("thermal_drift")
    t, ratio = moving_ratio(driven(effect.apply(QUIET), BACK_AND_FORTH))
    loss = value(effect, "cold_speed_loss") * np.exp(-t / value(effect, "time_constant"))
    np.testing.assert_allclose(ratio[10:], 1.0 - loss[10:], atol=1e-3)


def test_the_supply_varies_with_its_deviation_and_correlation():
    effect = drawn_effect("supply_variation")
    commands = held(*[(1, 1.0), (-1, 1.0)] * 900, joint=BUCKET)  # the joint with most room to stray in
    _, ratio = moving_ratio(driven(effect.apply(QUIET), commands), BUCKET)
    logarithm = np.log(ratio[10:])
    assert logarithm.std() == pytest.approx(value(effect, "std_log_speed"), rel=0.15)
    n_lag = round(value(effect, "correlation_time") / DT_S * 19 / 20)  # one row in twenty is left out
    assert np.corrcoef(logarithm[:-n_lag], logarithm[n_lag:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.12)


def test_a_cushion_slows_before_its_limit_and_only_towards_it():
    effect = drawn_effect("end_cushion", where=on_joint("swing"))
    sign, zone_rad = value(effect, "side"), value(effect, "zone_length")
    log = driven(effect.apply(QUIET), held((sign, 20.0), (-sign, 0.5)))
    speed, position = speeds(log, SWING), log.true_positions[:, SWING]
    distance = specification().upper[SWING] - sign * position  # limits of swing are alike
    middle = 0.5 * (distance[1:] + distance[:-1])
    in_zone = (middle[:300] < zone_rad - FULL_RAD_S * DT_S) & (distance[1:301] > 1e-6) & (np.arange(300) > 3)
    least = value(effect, "min_speed_ratio")
    expected = FULL_RAD_S * (least + (1.0 - least) * middle[:300][in_zone] / zone_rad)
    assert in_zone.sum() > 3
    np.testing.assert_allclose(np.abs(speed[:300][in_zone]), expected, rtol=0.05)
    assert speed[-5] == pytest.approx(-sign * FULL_RAD_S)
