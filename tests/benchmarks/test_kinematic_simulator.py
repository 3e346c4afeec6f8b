"""The kinematic simulator against closed forms: each effect does what the contract says, in the truth's numbers."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.effects.of_commands import REST_THRESHOLD_S
from benchmarks.closed_loop.kinematic.machine import JOINTS, Machine, Work, draw_machine
from benchmarks.closed_loop.kinematic.operator import RandomHolds, draw_random_style
from benchmarks.closed_loop.kinematic.session import drive, record_session
from benchmarks.closed_loop.kinematic.simulator import SUBSTEP_S
from benchmarks.closed_loop.kinematic.speed import read_levers
from benchmarks.closed_loop.machines import Variant, variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from pipeline.errors import InputError
from pipeline.plant.kinematics import BOOM_PIVOT_RADIUS_M, LINK_LENGTH_M, tip

DT_S = 0.05
SWING, BOOM, ARM, BUCKET = range(4)
FULL_RAD_S = 0.5
FASTEST_S = 1e-9  # time constant of a joint that follows at once
FINE_RAD = 1e-12


def quiet_machine():
    """A machine of which everything that is not the effect is gone: no variation, response at once, exact encoders."""
    drawn = draw_machine(specification(), 0, 1)
    n = len(JOINTS)
    changed = drawn.change("command_path", dead_time_s=np.full(n, 0.1), dead_time_jitter_s=0.0)
    changed = changed.change(
        "speed",
        full_speed_rad_s=np.full((n, 2), FULL_RAD_S),
        pose_dependence=np.zeros(n),
        gravity_loss=np.zeros(n),
        capacity=float(n),
        slow_std=0.0,
        fast_std=0.0,
    )
    fast = np.full(n, FASTEST_S)
    changed = changed.change("motion", rise_time_constant_s=fast, fall_time_constant_s=fast)
    return changed.change("encoder", noise_std_rad=0.0, quantum_rad=FINE_RAD)


QUIET = quiet_machine()
VARIANT = Variant(KINEMATIC, 0, QUIET, 1, (2, 3), (4, 5, 6))


class Script:
    """Somebody who does what is written, whatever the machine does."""

    def __init__(self, commands):
        self.rows = iter(commands)

    def command(self, measured):
        return next(self.rows)


def held(*holds, joint=SWING):
    """Commands of one joint, from pairs of value and duration in s."""
    values = np.concatenate([np.full(round(seconds / DT_S), value) for value, seconds in holds])
    commands = np.zeros((len(values), 4), dtype=np.int8)
    commands[:, joint] = values
    return commands


def driven(machine: Machine, commands, seed=0, start_time_ns=0, changes=()):
    minutes = len(commands) * DT_S / 60.0
    stream = np.random.SeedSequence(seed)
    return drive(specification(), machine, Script(commands), minutes, stream, start_time_ns, changes)


def speeds(log, joint):
    """Mean true speed of each control period but the first, rad/s."""
    return np.diff(log.true_positions[:, joint]) / DT_S


def drawn_effect(kind, seed=0, size=1.0, where=None):
    """The first effect of a kind, from a seed on, that is as wanted."""
    for number in range(seed, seed + 200):
        effect = effects.draw(kind, number, VARIANT, size)
        if where is None or where(effect):
            return effect
    raise AssertionError(kind)


def value(effect, name):
    return effect.truth[name].value


def on_joint(name):
    return lambda effect: effect.joints == (name,)


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


@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_gain_is_the_ratio_of_steady_speeds(direction):
    effect = drawn_effect("gain", where=lambda e: value(e, "direction") == direction)
    joint = JOINTS.index(effect.joints[0])
    log = driven(effect.apply(QUIET), held((1, 0.5), (-1, 0.5), (0, 0.2), joint=joint))
    for sign, row in ((1, 6), (-1, 16)):
        ratio = value(effect, "speed_ratio") if direction in (0, sign) else 1.0
        assert speeds(log, joint)[row] == pytest.approx(sign * FULL_RAD_S * ratio)


def test_delay_shifts_the_motion_by_its_time():
    effect = drawn_effect("delay", where=on_joint("swing"))
    commands = held((0, 0.3), (1, 1.0), (0, 0.8))
    sound, late = (driven(machine, commands).true_positions for machine in (QUIET, effect.apply(QUIET)))
    behind = (sound - late)[round(1.2 / DT_S), SWING]
    assert behind / FULL_RAD_S == pytest.approx(value(effect, "added_delay"), abs=SUBSTEP_S)
    np.testing.assert_allclose(sound[-1], late[-1])  # it stops later, too


def test_lag_falls_behind_by_its_time_constant_and_gets_there_exponentially():
    effect = drawn_effect("lag", where=on_joint("boom"))
    constant_s = value(effect, "added_time_constant")
    commands = held((1, 1.8), (0, 0.1), joint=BOOM)
    sound, late = (driven(m, commands).true_positions[:, BOOM] for m in (QUIET, effect.apply(QUIET)))
    t = DT_S * (1.0 + np.arange(len(sound))) - 0.1
    expected = FULL_RAD_S * constant_s * (1.0 - np.exp(-t / constant_s))
    np.testing.assert_allclose((sound - late)[2:10], expected[2:10], atol=FULL_RAD_S * SUBSTEP_S)


def test_oscillation_rings_with_its_frequency_and_damping():
    effect = drawn_effect("oscillation", where=on_joint("swing"))
    frequency_Hz, damping = value(effect, "frequency"), value(effect, "damping_ratio")
    log = driven(effect.apply(QUIET), held((1, 0.2), (0, 6.0)))
    speed = speeds(log, SWING)[round(0.6 / DT_S) :]
    peaks = np.flatnonzero((speed[1:-1] > speed[:-2]) & (speed[1:-1] > speed[2:])) + 1
    period_s = DT_S * np.mean(np.diff(peaks[:5]))
    assert period_s == pytest.approx(1.0 / (frequency_Hz * math.sqrt(1.0 - damping**2)), rel=0.03)
    decrement = 2.0 * np.pi * damping / math.sqrt(1.0 - damping**2)
    n = min(len(peaks) - 1, 4)
    assert math.log(speed[peaks[0]] / speed[peaks[n]]) == pytest.approx(n * decrement, rel=0.1)


def test_stiction_takes_its_mean_extra_time_after_long_rests_only():
    effect = drawn_effect("stiction", where=on_joint("swing"))
    extra_s = value(effect, "mean_extra_time")
    n_start, lost_s = 120, {}
    for rest_s in (0.5 * REST_THRESHOLD_S[0], 2.0 * REST_THRESHOLD_S[1]):
        # a first move that may stick and is left out, then there and back with the same rests
        commands = held((1, 1.0), *[(0, rest_s), (-1, 1.0), (0, rest_s), (1, 1.0)] * (n_start // 2), (0, 0.5))
        sound, stuck = (driven(m, commands) for m in (QUIET, effect.apply(QUIET)))
        ways = [np.abs(np.diff(log.true_positions[20:, SWING])).sum() for log in (sound, stuck)]
        lost_s[rest_s] = (ways[0] - ways[1]) / FULL_RAD_S / n_start
    assert min(lost_s.values()) == pytest.approx(0.0, abs=0.02)
    # gamma of shape 4: half of the mean is one standard deviation of a start
    assert max(lost_s.values()) == pytest.approx(extra_s, abs=4.0 * 0.5 * extra_s / math.sqrt(n_start))


def test_a_start_that_fails_leaves_the_valve_as_it_rested():
    threshold_s, extra_s = np.full(4, 0.5), np.full(4, 50.0)
    machine = QUIET.change("command_path", rest_threshold_s=threshold_s, mean_extra_time_s=extra_s)
    log = driven(machine, held((1, 0.3), (0, 0.1), (1, 0.3), (0, 0.3)))
    assert np.ptp(log.true_positions[:, SWING]) == 0.0


def test_flow_coupling_takes_its_share_while_others_move():
    effect = drawn_effect("flow_coupling")
    for n_other in range(4):
        commands = np.zeros((12, 4), dtype=np.int8)
        commands[:, : n_other + 1] = 1
        expected = FULL_RAD_S * (1.0 - value(effect, "loss_fraction") * n_other / 3.0)
        assert speeds(driven(effect.apply(QUIET), commands), SWING)[8] == pytest.approx(expected)
    assert effect.joints == JOINTS


def test_more_joints_than_the_supply_feeds_share_it():
    machine = QUIET.change("speed", capacity=2.0)
    log = driven(machine, np.ones((10, 4), dtype=np.int8))
    assert speeds(log, ARM)[6] == pytest.approx(FULL_RAD_S * 2.0 / 4.0)


def plant_levers(q):
    """The same from the plant's own geometry: the tip's distance from each axis along the ground."""
    radius_m = tip(q)[0][0] - BOOM_PIVOT_RADIUS_M
    angles = np.cumsum(q[1:])
    inner_m = np.concatenate([[0.0], np.cumsum(LINK_LENGTH_M * np.cos(angles))[:-1]])
    return np.concatenate([[0.0], (radius_m - inner_m) / np.cumsum(LINK_LENGTH_M[::-1])[::-1]])


def test_levers_are_those_of_the_tip():
    for q in np.random.default_rng(0).uniform(specification().lower, specification().upper, (20, 4)):
        levers = np.empty(4)
        read_levers(q, levers)
        np.testing.assert_allclose(levers, plant_levers(q), atol=1e-12)


def test_load_slows_lifting_and_hastens_lowering_and_states_the_mean_over_nominal_poses():
    of = variant(KINEMATIC, 0)
    effect = effects.draw("load", 5, of, 1.0)
    assert effect.joints == ("boom", "arm")
    loss = effect.apply(QUIET).quantities.speed.load_loss
    log = driven(effect.apply(QUIET), held((1, 0.3), (-1, 0.3), (0, 0.1), joint=BOOM))
    for sign, row in ((1, 4), (-1, 10)):
        lever = plant_levers(log.true_positions[row])[BOOM]
        assert speeds(log, BOOM)[row] == pytest.approx(
            sign * FULL_RAD_S * (1.0 - sign * loss[BOOM] * lever), rel=0.02
        )
    nominal = [
        KINEMATIC.record(specification(), of.parameters, (), of.style_seed, 12.0, seed, 0)
        for seed in of.session_seeds
    ]
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


BACK_AND_FORTH = held(*[(1, 1.0), (-1, 1.0)] * 60)


def moving_ratio(log, joint=SWING):
    """Speed over full speed by control period, where the joint moved all through it; with times, s."""
    speed = np.abs(speeds(log, joint))
    settled = np.ones(len(speed), dtype=bool)
    settled[1::20] = False  # in which it reverses
    return DT_S * (1.5 + np.flatnonzero(settled)), speed[settled] / FULL_RAD_S


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


def test_leakage_sags_at_rest_and_only_there():
    effect = drawn_effect("leakage", where=on_joint("boom"))
    rate = value(effect, "sag_rate")
    log = driven(effect.apply(QUIET), held((0, 1.0), (1, 0.5), (0, 1.0), joint=BOOM))
    assert rate < 0.0
    np.testing.assert_allclose(speeds(log, BOOM)[:19], rate)
    np.testing.assert_allclose(speeds(log, BOOM)[24:30], FULL_RAD_S)
    np.testing.assert_allclose(speeds(log, BOOM)[35:], rate)


def test_backlash_loses_its_width_on_reversal():
    effect = drawn_effect("backlash", where=on_joint("arm"))
    commands = held((1, 0.5), (-1, 0.5), (0, 0.2), joint=ARM)
    sound, loose = (driven(m, commands).true_positions[:, ARM] for m in (QUIET, effect.apply(QUIET)))
    width = value(effect, "width")
    assert (loose - sound)[10] == pytest.approx(-0.5 * width)
    assert (loose - sound)[-1] == pytest.approx(0.5 * width)


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


def test_stops_hold_and_let_go():
    commands = held((1, 8.0), (-1, 0.5), joint=BUCKET)
    for machine in (QUIET, draw_machine(specification(), 0, 1)):
        position = driven(machine, commands).true_positions[:, BUCKET]
        assert position.max() == specification().upper[BUCKET] == position[158]
        assert position[-1] < position[158] - 0.05


def test_sensor_bias_is_of_the_reading_alone():
    for is_offset in (True, False):
        effect = drawn_effect("sensor_bias", where=lambda e, o=is_offset: (value(e, "offset") != 0.0) == o)
        joint = JOINTS.index(effect.joints[0])
        commands = held((1, 0.5), (0, 0.5), joint=joint)
        sound, biased = (driven(m, commands) for m in (QUIET, effect.apply(QUIET)))
        np.testing.assert_array_equal(sound.true_positions, biased.true_positions)
        expected = value(effect, "scale") * sound.positions[:, joint] + value(effect, "offset")
        np.testing.assert_allclose(biased.positions[:, joint], expected, atol=1e-9)


def test_timing_makes_readings_old_by_its_latency():
    effect = drawn_effect("timing")
    log = driven(effect.apply(QUIET), held((1, 1.5), (0, 0.1), joint=BUCKET))
    stamp_s = 1e-9 * log.joint_state_header_stamp_ns
    moving = (stamp_s > 0.6) & (stamp_s < 1.5)
    ends_s = DT_S * (1.0 + np.arange(len(log.true_positions)))
    now = np.interp(stamp_s, ends_s, log.true_positions[:, BUCKET])
    age_s = (now - log.positions[:, BUCKET])[moving] / FULL_RAD_S
    assert age_s.mean() == pytest.approx(value(effect, "latency"), abs=0.003)
    assert age_s.std() < 0.01
    assert np.all(np.diff(stamp_s) > 0.0)


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


@pytest.mark.parametrize("number", range(3))
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


def test_an_effect_sets_in_at_its_moment():
    effect = drawn_effect("gain", where=lambda e: value(e, "direction") == 0)
    joint = JOINTS.index(effect.joints[0])
    log = driven(QUIET, held((1, 1.2), joint=joint), changes=((0.6, effect.apply(QUIET)),))
    speed = speeds(log, joint)
    np.testing.assert_allclose(speed[3:11], FULL_RAD_S)
    np.testing.assert_allclose(speed[11:], FULL_RAD_S * value(effect, "speed_ratio"))


def test_two_effects_act_together():
    gain = drawn_effect("gain", where=lambda e: e.joints == ("swing",) and value(e, "direction") == 0)
    bias = drawn_effect("sensor_bias", where=lambda e: e.joints == ("swing",) and value(e, "scale") != 1.0)
    log = driven(bias.apply(gain.apply(QUIET)), held((1, 1.0)))
    measured = np.polyfit(1e-9 * log.joint_state_header_stamp_ns[20:45], log.positions[20:45, SWING], 1)[0]
    assert measured == pytest.approx(FULL_RAD_S * value(gain, "speed_ratio") * value(bias, "scale"), rel=1e-3)


@pytest.mark.parametrize("kind", effects.KINDS)
@pytest.mark.parametrize("share", [0.02, 1.0])
def test_every_kind_works_at_its_smallest_and_largest(kind, share):
    of = variant(KINEMATIC, 1)
    for seed in range(3):
        effect = effects.draw(kind, seed, variant(KINEMATIC, 0), share * effects.KINDS[kind].largest_size)
        assert effect.joints and effect.depends_on and set(effect.joints) <= set(JOINTS)
        assert (effect.family == "other") == (kind in effects.OUTSIDE)
        log = record_session(specification(), effect.apply(of.parameters), 1, 0.2, seed, 0)
        assert np.isfinite(log.positions).all() and np.isfinite(log.true_positions).all()
        assert np.all(log.true_positions >= specification().lower)
        assert np.all(log.true_positions <= specification().upper)
        assert np.all(np.abs(np.diff(log.true_positions, axis=0)) < 2.0 * DT_S)


def test_sizes_out_of_bounds_and_unknown_kinds_are_refused():
    for size in (0.0, 3.0):
        with pytest.raises(InputError, match="size"):
            effects.draw("gain", 0, VARIANT, size)
    with pytest.raises(InputError, match="gremlins"):
        effects.draw("gremlins", 0, VARIANT, 1.0)


def test_a_session_follows_from_its_seed():
    of = variant(KINEMATIC, 0)
    first, again, other = (
        record_session(specification(), of.parameters, of.style_seed, 0.5, seed, 0) for seed in (1, 1, 2)
    )
    for name in ("positions", "commands", "joint_state_header_stamp_ns", "command_log_time_ns"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.commands, other.commands)


def test_a_log_is_like_the_plants():
    of = variant(KINEMATIC, 1)
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
        assert machine.work is (Work.painting if number % 2 else Work.random_holds)


def test_random_holds_stay_in_the_middle_and_have_pauses():
    at_sticks = RandomHolds(specification(), draw_random_style(1), 2)
    low = np.array([at_sticks.command(specification().lower) for _ in range(4000)])
    assert (low[low != 0] == 1).mean() > 0.9
    assert 0.2 < (low == 0).mean() < 0.95


def test_nothing_of_the_plant_but_its_operator_and_its_means_is_used():
    allowed = {"operator", "compiled", "records", "session"}
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
