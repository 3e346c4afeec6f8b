"""Effects on commands against closed forms, in the truth's numbers."""

import math

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic.effects.of_commands import REST_THRESHOLD_S
from benchmarks.closed_loop.kinematic.simulator import SUBSTEP_S
from tests.benchmarks.kinematic.scripted_machine import (
    BOOM,
    DT_S,
    FULL_RAD_S,
    QUIET,
    SWING,
    drawn_effect,
    driven,
    held,
    on_joint,
    speeds,
    value,
)


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
