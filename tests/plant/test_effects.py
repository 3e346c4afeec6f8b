"""Each effect changes what it says, by as much as its truth says, and nothing else."""

import dataclasses

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.plant import effects
from pipeline.plant.effects.change_point import wrap
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import (
    full_speed,
    mean_sag_rate,
    respond,
    ringing,
    sag_rate,
    start_for,
    start_time,
)
from pipeline.plant.simulator import Plant

from .conftest import MIDDLE, random_commands

CONTRACT = {
    "gain": {"speed_ratio", "direction"},
    "delay": {"added_delay"},
    "lag": {"added_time_constant"},
    "flow_coupling": {"loss_fraction"},
    "load": {"mean_speed_ratio_up", "mean_speed_ratio_down"},
    "thermal_drift": {"cold_speed_loss", "time_constant"},
    "supply_variation": {"std_log_speed", "correlation_time"},
    "leakage": {"sag_rate"},
    "backlash": {"width"},
    "stiction": {"mean_extra_time", "rest_threshold"},
    "end_cushion": {"zone_length", "min_speed_ratio", "side"},
    "sensor_bias": {"offset", "scale"},
    "timing": {"latency"},
    "oscillation": {"frequency", "damping_ratio"},
    "other": set(),
}


def draw_where(kind, nominal, condition, size=1.0):
    """The first seed whose effect fulfils the condition."""
    for seed in range(100):
        effect = effects.draw(kind, seed, nominal, size)
        if condition(effect):
            return effect, JOINT_NAMES.index(effect.joints[0])
    raise AssertionError(f"no such {kind} among a hundred")


@pytest.mark.parametrize("kind", effects.KINDS)
def test_every_kind_is_drawn_by_seed_and_moves_the_machine_otherwise(kind, nominal):
    effect, again = (effects.draw(kind, 3, nominal, 1.0) for _ in range(2))
    assert dataclasses.replace(effect, apply=again.apply) == again
    assert CONTRACT[effect.family] <= set(effect.truth)
    assert effect.joints
    assert set(effect.joints) <= set(JOINT_NAMES)
    assert all(np.isfinite(quantity.value) for quantity in effect.truth.values())
    commands = random_commands(1, 240, 25)
    before, after = (
        Plant(p, 0, MIDDLE).run(commands).joint_states.position_rad for p in (nominal, effect.apply(nominal))
    )
    n = min(len(before), len(after))
    assert np.sqrt(np.mean((before[:n] - after[:n]) ** 2, axis=0)).max() > 2e-3


def test_all_families_of_the_contract_are_there(nominal):
    families = {effects.draw(kind, 0, nominal, 1.0).family for kind in effects.KINDS}
    assert families == set(CONTRACT)  # change_point wraps any of them
    assert sum(effects.draw(kind, 0, nominal, 1.0).family == "other" for kind in effects.KINDS) >= 3


def test_gain_in_one_direction_leaves_the_other(nominal):
    effect, joint = draw_where("gain", nominal, lambda e: e.truth["direction"].value == -1)
    changed = effect.apply(nominal)
    ratio = {d: full_speed(changed, joint, d) / full_speed(nominal, joint, d) for d in (-1, 1)}
    assert ratio[-1] == pytest.approx(effect.truth["speed_ratio"].value, rel=1e-6)
    assert abs(ratio[-1] - 1.0) > 0.1
    assert ratio[1] == pytest.approx(1.0, abs=1e-3)
    for other in set(range(4)) - {joint}:
        assert full_speed(changed, other, -1) == pytest.approx(full_speed(nominal, other, -1), rel=1e-3)


def test_delay_shifts_the_response(nominal):
    effect, joint = draw_where("delay", nominal, lambda e: True)
    delay = effect.truth["added_delay"].value
    before, after = (respond(p, joint, 1, 1.5) for p in (nominal, effect.apply(nominal)))
    shifted = np.interp(after.time_s - delay, before.time_s, before.angle_rad, left=before.angle_rad[0])
    assert np.max(np.abs(after.angle_rad - shifted)) < 1e-3
    assert np.max(np.abs(after.angle_rad - before.angle_rad)) > 0.02


def test_lag_slows_the_rise_but_keeps_the_final_speed(nominal):
    effect, joint = draw_where("lag", nominal, lambda e: True)
    changed = effect.apply(nominal)
    assert start_time(changed, joint, 1) > start_time(nominal, joint, 1) + 0.02
    before, after = (respond(p, joint, 1, 3.2).speed_rad_s[-1] for p in (nominal, changed))
    assert after == pytest.approx(before, rel=0.08)


def test_flow_coupling_spares_single_motions(nominal):
    effect, _ = draw_where("flow_coupling", nominal, lambda e: True)
    changed = effect.apply(nominal)
    for name in effect.joints:
        joint = JOINT_NAMES.index(name)
        alone = full_speed(changed, joint, 1) / full_speed(nominal, joint, 1)
        together = full_speed(changed, joint, 1, others=np.ones(4)) / full_speed(
            nominal, joint, 1, others=np.ones(4)
        )
        assert together < 0.95 * alone
        assert alone == pytest.approx(1.0, abs=0.25)


def test_leakage_sags_at_zero_command_only_where_it_is(nominal):
    effect, joint = draw_where("leakage", nominal, lambda e: True)
    changed = effect.apply(nominal)
    assert mean_sag_rate(changed, joint) == pytest.approx(effect.truth["sag_rate"].value)
    assert abs(sag_rate(changed, joint)) > 0.005
    assert abs(sag_rate(changed, 0)) < 1e-3


def test_backlash_is_lost_on_reversal(nominal):
    effect, joint = draw_where("backlash", nominal, lambda e: True)
    plant = Plant(effect.apply(nominal), 0, start_for(nominal, joint, 1))
    command = np.zeros((40, 4))
    command[:, joint] = 1.0
    plant.run(command)
    plant.run(-command)
    play = plant.state.link_angle_rad[joint] - plant.state.angle_rad[joint]
    width = effect.truth["width"].value + nominal.linkage.play_rad[joint]
    assert play == pytest.approx(0.5 * width)


def test_stiction_delays_starts_after_rest_only(nominal):
    effect, joint = draw_where("stiction", nominal, lambda e: True)
    changed = effect.apply(nominal)
    extra = {
        rest: start_time(changed, joint, 1, rest) - start_time(nominal, joint, 1, rest)
        for rest in (0.05, 4.0)
    }
    assert extra[4.0] > 0.1
    assert extra[0.05] < 0.5 * extra[4.0]


def test_end_cushion_slows_only_its_zone(nominal):
    effect, joint = draw_where("end_cushion", nominal, lambda e: e.truth["side"].value == 1)
    before, after = (respond(p, joint, 1, 12.0) for p in (nominal, effect.apply(nominal)))
    zone = nominal.linkage.upper_rad[joint] - effect.truth["zone_length"].value
    outside = before.angle_rad < zone - 0.01
    np.testing.assert_allclose(after.angle_rad[outside], before.angle_rad[outside], atol=2e-3)
    inside = (after.angle_rad > zone) & (after.angle_rad < nominal.linkage.upper_rad[joint] - 0.05)
    plain = np.interp(after.angle_rad[inside], before.angle_rad, before.speed_rad_s)
    assert np.min(after.speed_rad_s[inside] / plain) == pytest.approx(
        effect.truth["min_speed_ratio"].value, abs=0.1
    )


def test_sensor_bias_leaves_the_motion(nominal):
    effect, joint = draw_where("sensor_bias", nominal, lambda e: e.truth["offset"].value != 0.0)
    commands = random_commands(0, 20, 20)
    before, after = (Plant(p, 0, MIDDLE).run(commands) for p in (nominal, effect.apply(nominal)))
    np.testing.assert_array_equal(before.angle_rad, after.angle_rad)
    difference = np.mean(after.joint_states.position_rad - before.joint_states.position_rad, axis=0)
    expected = np.zeros(4)
    expected[joint] = effect.truth["offset"].value
    np.testing.assert_allclose(difference, expected, atol=1e-4)


def test_timing_makes_stamps_late(nominal):
    effect, _ = draw_where("timing", nominal, lambda e: True)
    sample = Plant(effect.apply(nominal), 0, MIDDLE).run(random_commands(0, 40, 20))
    latency = effect.truth["latency"].value
    states = sample.joint_states
    used = states.stamp_s > latency + 0.1
    errors = [
        np.mean(
            (
                np.interp(states.stamp_s - shift, sample.end_s, sample.angle_rad[:, 0])
                - states.position_rad[:, 0]
            )[used]
            ** 2
        )
        for shift in (0.0, latency)
    ]
    assert errors[1] < 0.05 * errors[0]


@pytest.mark.parametrize("kind", effects.KINDS)
def test_an_effect_on_one_joint_leaves_the_others_alone(kind, nominal):
    effect = effects.draw(kind, 1, nominal, 1.0)
    if len(effect.joints) > 1:
        pytest.skip("acts on several joints")
    for joint, name in enumerate(JOINT_NAMES):
        if name in effect.joints:
            continue
        before, after = (respond(p, joint, 1, 1.2).speed_rad_s for p in (nominal, effect.apply(nominal)))
        # gravity and inertia of a joint that sags or rings are felt by its neighbours, a little
        assert np.abs(after - before).max() < 0.1 * np.abs(before).max()


def test_oscillation_rings_slower_than_the_sound_machine(nominal):
    effect, joint = draw_where("oscillation", nominal, lambda e: e.joints == ("swing",))
    sound = ringing(nominal, joint, 1)
    assert effect.truth["frequency"].value < 0.7 * sound.frequency_Hz
    assert 0.0 < effect.truth["damping_ratio"].value < 0.2


def test_supply_variation_states_the_speed_variation_it_causes(nominal):
    effect, _ = draw_where("supply_variation", nominal, lambda e: True)
    changed = effect.apply(nominal)
    assert changed.supply.ripple_std > 5 * nominal.supply.ripple_std
    assert 0.03 < effect.truth["std_log_speed"].value < 0.25


def test_pilot_crosstalk_acts_only_while_the_source_moves(nominal):
    effect, joint = draw_where("pilot_crosstalk", nominal, lambda e: True)
    changed = effect.apply(nominal)
    direction = int(effect.truth["direction"].value)
    assert full_speed(changed, joint, direction) == pytest.approx(
        full_speed(nominal, joint, direction), rel=1e-6
    )
    assert effect.truth["speed_ratio_while_source_moves"].value > 1.05


def test_coil_fade_slows_down_with_hold_time(nominal):
    effect, joint = draw_where("coil_fade", nominal, lambda e: True)
    before, after = (respond(p, joint, 1, 3.0) for p in (nominal, effect.apply(nominal)))
    early, late = before.time_s < 0.6, before.time_s > 2.8
    assert np.mean(after.speed_rad_s[late]) < 0.9 * np.mean(before.speed_rad_s[late])
    assert np.mean(after.speed_rad_s[early]) > 0.8 * np.mean(before.speed_rad_s[early])


def test_half_size_is_weaker(nominal):
    full, half = (effects.draw("delay", 0, nominal, size).truth["added_delay"].value for size in (1.0, 0.5))
    assert half == pytest.approx(0.5 * full)


def test_change_point_keeps_the_effect_and_adds_its_onset(nominal):
    effect = effects.draw("delay", 0, nominal, 1.0)
    wrapped = wrap(np.random.default_rng(0), effect, 600.0)
    assert 0.3 * 600 <= wrapped.onset_s <= 0.7 * 600
    assert wrapped.truth["added_delay"] == effect.truth["added_delay"]


def test_unknown_kinds_and_sizes_are_refused(nominal):
    with pytest.raises(InputError, match="gremlins"):
        effects.draw("gremlins", 0, nominal, 1.0)
    with pytest.raises(InputError, match="size"):
        effects.draw("gain", 0, nominal, 0.0)
