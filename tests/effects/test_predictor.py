"""Predictions on logs of simulated machines that have exactly one effect: with the true values they are right."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import DT_S, LOWER, SETTING, SPEED, UPPER
from .linear_machine import SHARE, commands, linear_model, simulated

TARGETS = ["dq", "dqdot"]
STARTS, HORIZON = np.array([12, 35, 60, 88]), 30
MIDDLE, HALF = 0.5 * (LOWER + UPPER), 0.5 * (UPPER - LOWER)


def late(steps):
    return lambda t, a: a[t - steps] if t >= steps else np.zeros(2)


def lagged(tau):
    return lambda t, u, v, a, q: v + DT_S / (tau + DT_S) * (u - v)


def cushioned(t, u, v, a, q):
    near = np.clip(1 - (UPPER - q) / (0.4 * (UPPER - LOWER)), 0, 1)
    return np.where(u > 0, u * (1 - np.array([0.6, 0.3]) * near), u)


def loaded(t, u, v, a, q):
    slope = np.array([[0.0, 0.3], [-0.2, 0.0]]) @ ((q - MIDDLE) / HALF)
    return u * np.where(u > 0, np.array([0.8, 0.9]) - slope, np.array([1.2, 1.0]) + slope)


# Family, values, and the machine's difference from the nominal one, each written from the card's equation.
CASES = {
    "gain": (
        {"ratio_positive": [1.4, 0.7], "ratio_negative": [0.8, 1.0]},
        {"on_velocity": lambda t, u, v, a, q: u * np.where(u > 0, [1.4, 0.7], [0.8, 1.0])},
    ),
    "delay": ({"added_delay": [0.15, 0.15]}, {"on_command": late(3)}),
    "timing": ({"latency": [0.1, 0.1]}, {"on_command": late(2)}),
    "lag": ({"added_time_constant": [0.15, 0.1]}, {"on_velocity": lagged(np.array([0.15, 0.1]))}),
    "leakage": (
        {"sag_rate": [-0.02, 0.004]},
        {"on_velocity": lambda t, u, v, a, q: u + np.where(a == 0, [-0.02, 0.004], 0.0)},
    ),
    "thermal_drift": (
        {"cold_speed_loss": [0.5, 0.3], "warm_gain": [0.1, 0.1], "time_constant": [4.0, 4.0]},
        {"on_velocity": lambda t, u, v, a, q: u * (1.1 - np.array([0.5, 0.3]) * np.exp(-DT_S * t / 4.0))},
    ),
    "flow_coupling": (
        {"loss_fraction": [[0.0, 0.3], [0.2, 0.0]]},
        {"on_velocity": lambda t, u, v, a, q: u * (1 - np.array([0.3, 0.2]) * (np.abs(u) / SPEED)[::-1])},
    ),
    "load": (
        {
            "mean_speed_ratio_up": [0.8, 0.9],
            "mean_speed_ratio_down": [1.2, 1.0],
            "load_slope": [[0.0, 0.3], [-0.2, 0.0]],
        },
        {"on_velocity": loaded},
    ),
    "end_cushion": (
        {"loss_upper": [0.6, 0.3], "loss_lower": [0.0, 0.0], "zone_share": [0.4, 0.4]},
        {"on_velocity": cushioned},
    ),
    "sensor_bias": (
        {"offset": [0.1, -0.02], "scale": [1.2, 0.9]},
        {"sensor": lambda q: q * [1.2, 0.9] + [0.1, -0.02], "sensor_scale": np.array([1.2, 0.9])},
    ),
}  # fmt: skip


def make_predictor(family, values, target, share=SHARE, onset_ns=None) -> AugmentedPredictor:
    model, theta = linear_model(target, share)
    complete = KNOWN[family](SETTING).neutral() | as_arrays(values)
    chain = Chain([KNOWN[family]], SETTING)
    return AugmentedPredictor(model, theta, chain, {family: complete}, onset_ns, has_stops=False)


def as_arrays(values):
    return {name: np.array(value, np.float32) for name, value in values.items()}


def predicted(family, values, log, target, horizon=HORIZON, starts=STARTS, share=SHARE, onset_ns=None):
    return make_predictor(family, values, target, share, onset_ns).predict(log, starts, horizon)


def measured(log, starts=STARTS, horizon=HORIZON):
    return log.q[starts[:, None] + 1 + np.arange(horizon)]


BOTH = [(family, target) for family in ("gain", "lag", "sensor_bias") for target in TARGETS]
OTHERS = [
    (family, TARGETS[n % 2])
    for n, family in enumerate(family for family in CASES if (family, "dq") not in BOTH)
]


@pytest.mark.parametrize(("family", "target"), BOTH + OTHERS)
def test_with_the_true_values_predictions_are_right(family, target):
    values, machine = CASES[family]
    log = simulated(commands(7, 130), **machine)
    predictor = make_predictor(family, values, target)
    right = np.abs(predictor.predict(log, STARTS, HORIZON) - measured(log)).max()
    neutral = {family: as_arrays(KNOWN[family](SETTING).neutral())}
    wrong = np.abs(predictor.with_values(neutral).predict(log, STARTS, HORIZON) - measured(log)).max()
    assert wrong > 3e-3
    assert right < max(5e-5, 0.01 * wrong)


@pytest.mark.parametrize("target", TARGETS)
def test_stiction_holds_back_the_starts_after_rest(target):
    a = np.zeros((130, 2))
    a[20:40], a[44:60], a[100:120] = 1.0, -1.0, [0.0, 1.0]
    extra, threshold_s = 0.1, 0.4
    reaching = a.copy()
    for begin, rest_s in [
        (20, 60.0 + 1.0),
        (44, 0.2),
        (100, 2.0),
    ]:  # before the log it had been at rest for a minute
        late = extra / DT_S * rest_s**3 / (rest_s**3 + threshold_s**3)
        for step in range(2):
            reaching[begin + step] *= np.clip(step + 1 - late, 0.0, 1.0)
    log = simulated(a, on_command=lambda t, _: reaching[t])
    values = {"mean_extra_time": [extra, extra], "rest_threshold": [threshold_s, threshold_s]}
    np.testing.assert_allclose(predicted("stiction", values, log, target), measured(log), atol=5e-5)


@pytest.mark.parametrize("target", TARGETS)
def test_backlash_takes_the_width_at_every_reversal(target):
    """With a drive without memory the nominal window does not matter, which the gap hides."""
    a = np.zeros((130, 2))
    a[8:30], a[30:60], a[70:90], a[90:120] = 1.0, -1.0, -1.0, 1.0
    width, gap = np.array([0.06, 0.008]), np.zeros((2,))

    def link(t, u, v, a, q):
        nonlocal gap
        moved = np.clip(gap + DT_S * u, 0, width)
        v, gap = u - (moved - gap) / DT_S, moved
        return v

    log = simulated(a, on_velocity=link, share=1.0)
    found = predicted("backlash", {"width": width}, log, target, share=1.0)
    np.testing.assert_allclose(found, measured(log), atol=5e-5)


def test_windows_beyond_the_logs_last_row_and_many_windows_are_served():
    log = simulated(commands(7, 130))
    starts = np.arange(4, 129).repeat(3)
    found = predicted("gain", KNOWN["gain"](SETTING).neutral(), log, "dqdot", horizon=2, starts=starts)
    inside = starts < 128
    np.testing.assert_allclose(found[inside], measured(log, starts[inside], 2), atol=5e-5)
    assert len(found) == len(starts) and np.all(np.isfinite(found))


def test_with_play_a_link_pushed_against_its_stop_ends_half_the_width_before():
    model, theta = linear_model("dqdot")
    width = {"width": np.array([0.06, 0.0], np.float32)}
    predictor = AugmentedPredictor(model, theta, Chain([KNOWN["backlash"]], SETTING), {"backlash": width})
    log = simulated(np.concatenate([np.zeros((30, 2)), np.ones((100, 2)), -np.ones((100, 2))]))
    log = replace(log, q=log.q[:1] + np.zeros_like(log.q), qd=np.zeros_like(log.q))
    pushed, back = np.split(predictor.predict(log, np.array([20]), 209)[0], [110])
    np.testing.assert_allclose(pushed[-1], UPPER - np.array([0.03, 0.0]), atol=1e-5)
    np.testing.assert_allclose(back[-1], LOWER + np.array([0.03, 0.0]), atol=1e-5)
