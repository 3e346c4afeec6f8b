"""Effects on position and its reading against closed forms, in the truth's numbers."""

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic.machine import JOINTS
from tests.benchmarks.kinematic.scripted_machine import (
    ARM,
    BOOM,
    BUCKET,
    DT_S,
    FULL_RAD_S,
    QUIET,
    drawn_effect,
    driven,
    held,
    on_joint,
    speeds,
    value,
)


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
