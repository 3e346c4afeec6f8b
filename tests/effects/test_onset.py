"""Effects that set in at a stamp: the frozen model before it, the full effect after it."""

import jax
import numpy as np
import pytest

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import SETTING, VALUES, make_model, random_trajectory
from .linear_machine import commands, simulated
from .test_predictor import CASES, late, measured, predicted

ONSET_ROW = 60
BEFORE, AFTER = np.array([10, 30, 49]), np.array([62, 70, 80])
TARGETS = ["dq", "dqdot"]
SETTING_IN = ["gain", "delay", "lag", "leakage", "sensor_bias", "backlash", "stiction", "load"]


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.usefixtures("optimised")
def test_before_the_stamp_the_model_is_the_frozen_one_and_after_it_the_full_one(target):
    model, log = make_model("mlp", target), random_trajectory(4, 100)
    theta = model.initialise(jax.random.key(0))
    chain = Chain([KNOWN[family] for family in SETTING_IN], SETTING)
    values = {family: VALUES[family] for family in SETTING_IN}
    bare = AugmentedPredictor(model, theta, Chain([], SETTING), {}).predict(log, BEFORE, 11)
    onset_ns = dict.fromkeys(SETTING_IN, dict.fromkeys(range(2), int(log.stamp_ns[ONSET_ROW])))
    predictor = AugmentedPredictor(model, theta, chain, values, onset_ns)
    np.testing.assert_array_equal(predictor.predict(log, BEFORE, 11), bare)
    predictor.onset_ns = dict.fromkeys(SETTING_IN, dict.fromkeys(range(2), 0))
    from_start = predictor.predict(log, AFTER, 11)
    always = AugmentedPredictor(model, theta, chain, values)
    np.testing.assert_allclose(from_start, always.predict(log, AFTER, 11), atol=1e-5)
    assert np.abs(always.predict(log, BEFORE, 11) - bare).max() > 0.01


@pytest.mark.parametrize(("family", "target"), [("gain", "dq"), ("delay", "dqdot"), ("flow_coupling", "dq")])
def test_a_machine_that_changes_within_the_log_is_predicted_throughout(family, target):
    values, machine = CASES[family]
    on_command = machine.get("on_command", late(0))
    on_velocity = machine.get("on_velocity", lambda t, u, v, a, q: u)
    log = simulated(
        commands(7, 130),
        on_command=lambda t, a: on_command(t, a) if t >= ONSET_ROW else a[t],
        on_velocity=lambda t, u, v, a, q: on_velocity(t, u, v, a, q) if t >= ONSET_ROW else u,
    )
    starts = np.concatenate([BEFORE, [59, 60, 61], AFTER])  # windows before, across and after
    onset_ns = {family: dict.fromkeys(range(2), int(log.stamp_ns[ONSET_ROW]))}
    found = predicted(family, values, log, target, starts=starts, onset_ns=onset_ns)
    np.testing.assert_allclose(found, measured(log, starts), atol=2e-4)


@pytest.mark.parametrize("target", TARGETS)
def test_an_encoder_that_slips_within_the_log_is_corrected_from_then_on(target):
    values, _ = CASES["sensor_bias"]
    log = simulated(commands(7, 130))
    q, qd = log.q.copy(), log.qd.copy()
    q[ONSET_ROW:] = q[ONSET_ROW:] * [1.2, 0.9] + [0.1, -0.02]
    qd[ONSET_ROW:] *= [1.2, 0.9]
    log = type(log)(**{**vars(log), "q": q, "qd": qd})
    onset_ns = {"sensor_bias": dict.fromkeys(range(2), int(log.stamp_ns[ONSET_ROW]))}
    starts = np.concatenate([[10, 29], AFTER])  # no window across
    found = predicted("sensor_bias", values, log, target, starts=starts, onset_ns=onset_ns)
    np.testing.assert_allclose(found, measured(log, starts), atol=2e-4)


# Rows from which on the first and the second joint have it; 0: all the time.
EACH_ITS_OWN = [(40, 80), (80, 40), (60, 0), (0, 60)]


@pytest.mark.parametrize("rows", EACH_ITS_OWN)
@pytest.mark.parametrize(
    ("family", "target"), [("gain", "dqdot"), ("flow_coupling", "dq"), ("load", "dqdot")]
)
def test_each_joint_has_its_own_onset(family, target, rows):
    values, machine = CASES[family]
    first = np.array(rows)

    def on_velocity(t, u, v, a, q):
        return np.where(t >= first, machine["on_velocity"](t, u, v, a, q), u)

    log = simulated(commands(7, 130), on_velocity=on_velocity)
    onset_ns = {family: {joint: int(log.stamp_ns[row]) for joint, row in enumerate(rows) if row > 0}}
    starts = np.arange(10, 128)
    one_step = predicted(family, values, log, target, horizon=1, starts=starts, onset_ns=onset_ns)
    np.testing.assert_allclose(one_step, measured(log, starts, 1), atol=1e-6)
    across = np.array([12, 35, 50, 70, 90])
    found = predicted(family, values, log, target, starts=across, onset_ns=onset_ns)
    np.testing.assert_allclose(found, measured(log, across), atol=2e-4)
    # With one onset for both, as the earlier one, the later joint is wrong in between.
    earlier = {family: dict.fromkeys(range(2), min(onset_ns[family].values()))}
    wrong = predicted(family, values, log, target, horizon=1, starts=starts, onset_ns=earlier)
    assert np.abs(wrong - measured(log, starts, 1)).max() > 3e-5
