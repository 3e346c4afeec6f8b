"""Effects that no catalogue has, against closed forms, in the truth's numbers."""

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.machine import JOINTS
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from tests.benchmarks.kinematic.scripted_machine import (
    BACK_AND_FORTH,
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
    speeds,
    value,
)


def test_a_joint_hears_another_ones_command_in_one_direction():
    effect = drawn_effect("command_crosstalk")
    joint = JOINTS.index(effect.joints[0])
    source = JOINTS.index(effect.depends_on[0].removeprefix("command:"))
    sign = int(value(effect, "source_direction"))
    for other, ratio in ((sign, value(effect, "speed_ratio")), (-sign, 1.0), (0, 1.0)):
        commands = held((1, 0.6), joint=joint)
        commands[:, source] = other
        assert speeds(driven(effect.apply(QUIET), commands), joint)[8] == pytest.approx(FULL_RAD_S * ratio)


def test_a_held_valve_fades_and_starts_anew():
    effect = drawn_effect("hold_fade", where=on_joint("bucket"))
    log = driven(effect.apply(QUIET), held((1, 1.0), (-1, 1.0), (0, 0.1), joint=BUCKET))
    t = DT_S * (np.arange(6, 18) + 1.5) - 0.1
    faded = 1.0 - value(effect, "held_speed_loss") * (1.0 - np.exp(-t / value(effect, "time_constant")))
    np.testing.assert_allclose(speeds(log, BUCKET)[6:18], FULL_RAD_S * faded, rtol=2e-3)
    np.testing.assert_allclose(speeds(log, BUCKET)[26:38], -FULL_RAD_S * faded, rtol=2e-3)


def test_wear_grows_with_travel():
    effect = drawn_effect("travel_wear", where=on_joint("swing"))
    _, ratio = moving_ratio(driven(effect.apply(QUIET), BACK_AND_FORTH))
    log = driven(effect.apply(QUIET), BACK_AND_FORTH)
    travel_rad = np.abs(np.diff(log.true_positions[:, SWING])).sum()
    assert ratio[-2] == pytest.approx(1.0 - value(effect, "speed_loss_per_travel") * travel_rad, abs=0.005)


def test_activity_of_one_joint_slows_all():
    effect = drawn_effect("activity_sag")
    log = driven(effect.apply(QUIET), BACK_AND_FORTH)
    t, ratio = moving_ratio(log)
    activity = 1.0 - np.exp(-(t - 0.1) / value(effect, "averaging_time"))  # one of four joints is typical
    np.testing.assert_allclose(ratio[10:], 1.0 - value(effect, "speed_loss") * activity[10:], atol=2e-3)


def test_a_joint_loses_speed_where_another_stands():
    effect = drawn_effect("position_crosstalk", where=on_joint("swing"))
    source = JOINTS.index(effect.depends_on[0].removeprefix("position:"))
    commands, away = (held((0, 12.0), (1, 0.3), (0, 0.1)) for _ in range(2))
    commands[:200, source], away[:200, source] = 1, -1  # as far as it goes
    slow, free = (speeds(driven(effect.apply(QUIET), c), SWING)[244] for c in (commands, away))
    assert slow / free == pytest.approx(1.0 - value(effect, "speed_loss"))
    assert free == pytest.approx(FULL_RAD_S)


@pytest.mark.parametrize("number", range(8, 11))
def test_a_joint_that_throttles_another_works_on_both_sides_of_where_it_begins(number):
    drawn = variant(KINEMATIC, number)
    effect = effects.draw("position_crosstalk", number, drawn, 1.0)
    joint, source = (JOINTS.index(of) for of in (effect.joints[0], effect.depends_on[0].split(":")[1]))
    log = record_session(specification(), drawn.parameters, drawn.style_seed, 12.0, 99, start_time_ns=0)
    places = log.true_positions[log.commands[:, joint] != 0, source]
    assert 0.05 < np.mean(places > value(effect, "begins_at")) < 0.95


def test_a_cycle_follows_the_wall_clock_and_not_the_sessions_start():
    effect = drawn_effect("clock_cycle", where=on_joint("swing"))
    period_s = value(effect, "period")
    for begin_s, ratio in ((0.0, 1.0 - value(effect, "speed_loss")), (0.5 * period_s, 1.0)):
        start_ns = round((1000 * period_s + begin_s) * 1e9)
        log = driven(effect.apply(QUIET), held((1, 0.6)), start_time_ns=start_ns)
        assert speeds(log, SWING)[8] == pytest.approx(FULL_RAD_S * ratio)


def test_a_command_that_is_held_is_boosted():
    effect = drawn_effect("hold_boost", where=on_joint("swing"))
    after = round(value(effect, "held_for") / DT_S)
    away_s = 1.5  # else the stop comes first
    speed = speeds(driven(effect.apply(QUIET), held((-1, away_s), (1, 2.5))), SWING)[round(away_s / DT_S) :]
    np.testing.assert_allclose(speed[5 : after - 2], FULL_RAD_S)
    np.testing.assert_allclose(
        speed[after + 6 : after + 10], FULL_RAD_S * (1.0 + value(effect, "speed_gain"))
    )


def test_a_reversal_locks_the_valve_whether_or_not_there_is_a_rest_between():
    effect = drawn_effect("reversal_lockout", where=on_joint("swing"))
    lockout = round(value(effect, "lockout") / DT_S)
    for rest_s in (0.0, 0.5):
        commands = held((1, 0.5), (0, rest_s), (-1, 1.5), (0, 0.2), (-1, 0.5))
        late, sound = (speeds(driven(of, commands), SWING) for of in (effect.apply(QUIET), QUIET))
        begins = [int(np.argmax(speed < -0.5 * FULL_RAD_S)) for speed in (late, sound)]
        assert begins[0] - begins[1] == pytest.approx(lockout, abs=1)
        np.testing.assert_allclose(late[-10:], sound[-10:])  # the same sign again is not a reversal
