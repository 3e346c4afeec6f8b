"""What holds for every effect: bounds, onset, several at once."""

import numpy as np
import pytest

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.machine import JOINTS
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from pipeline.errors import InputError
from tests.benchmarks.kinematic.scripted_machine import (
    DT_S,
    FULL_RAD_S,
    QUIET,
    SWING,
    VARIANT,
    drawn_effect,
    driven,
    held,
    speeds,
    value,
)


@pytest.mark.long
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
    of = variant(KINEMATIC, 9)
    for seed in range(3):
        effect = effects.draw(kind, seed, variant(KINEMATIC, 8), share * effects.KINDS[kind].largest_size)
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
