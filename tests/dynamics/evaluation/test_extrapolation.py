"""Rollouts outside the training distribution, of predictors whose behaviour is known in closed form."""

import jax
import numpy as np
import pytest

from pipeline.dynamics.evaluation.extrapolation import (
    ExtrapolationConfig,
    command_patterns,
    extrapolate,
    largest_speed,
    simulate_from_rest,
)
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.references.arx import fit_arx
from pipeline.dynamics.references.grey_box import GreyBoxPredictor
from pipeline.errors import InputError
from pipeline.machine.specification import JointSpecification, MachineSpecification
from tests.dynamics.conftest import lag_trajectory, make_trajectory

DT_S = 0.05


def config(**changes) -> ExtrapolationConfig:
    values = {
        "seed": 0,
        "configurations": 6,
        "steps": 200,
        "motion_steps": 10,
        "settle_steps": 20,
        "all_combinations_up_to_joints": 2,
    }
    return ExtrapolationConfig(**(values | changes))


class Scripted:
    """q[s+h] = q[s] + h Δt rate(commands up to then), with what each test wants."""

    rows_before = 1

    def __init__(self, rate):
        self._rate = rate

    def predict(self, trajectory, starts, horizon):
        commands = trajectory.a[starts[:, None] + np.arange(horizon)]
        return trajectory.q[starts][:, None] + np.cumsum(DT_S * self._rate(commands), axis=1)


SPEED = np.array([0.4, 0.3])
ONES = np.ones(2)


def test_a_joint_that_obeys_leaves_its_limits_and_stops(machine):
    measured = extrapolate(Scripted(lambda a: SPEED * a), machine, ONES, config())
    assert measured.left_limits.tolist() == [1.0, 1.0]  # 4 and 3 rad in 10 s; the range is 2 rad
    assert np.all(measured.beyond_largest < SPEED * 10.0)
    assert np.all(measured.beyond_largest > SPEED * 10.0 - 2.0)
    for name in (
        "moved_uncommanded",
        "drift_at_rest",
        "residual_speed_largest",
        "creep_after_stop",
        "unbounded",
    ):
        np.testing.assert_allclose(getattr(measured, name), 0.0, atol=1e-12)
    np.testing.assert_allclose(measured.speed_ratio, SPEED)
    np.testing.assert_allclose(measured.speed_ratio_inside, SPEED)


def test_leaving_by_a_known_distance():
    """One joint, one direction from each start: how far beyond is start + 2 - limit."""
    machine = MachineSpecification("one", 20.0, [JointSpecification("only", 0.0, 1.0)])
    starts = np.random.default_rng(0).uniform([0.0], [1.0], (18, 1))[:, 0]  # six per pattern -1, 0, 1
    measured = extrapolate(Scripted(lambda a: 0.2 * a), machine, np.ones(1), config())
    beyond = np.concatenate([2.0 - starts[:6], starts[12:] + 2.0 - 1.0])
    np.testing.assert_allclose(measured.beyond_largest, beyond.max())
    np.testing.assert_allclose(measured.beyond_median, np.median(beyond))
    assert measured.left_limits.tolist() == [1.0]
    assert np.isnan(measured.moved_uncommanded).all()  # there is no other joint


def test_drift_is_seen(machine):
    measured = extrapolate(Scripted(lambda a: 0.001 * np.ones_like(a)), machine, ONES, config())
    np.testing.assert_allclose(measured.drift_at_rest, 0.001 * 10.0)
    np.testing.assert_allclose(measured.residual_speed_median, 0.001)
    np.testing.assert_allclose(measured.creep_after_stop, 0.001 * DT_S * 170)
    assert 0.0 < measured.moved_uncommanded.max() <= 0.01 + 1e-9


def test_coasting_is_seen(machine):
    """First-order lag of 0.5 s: 1 s after the stop the speed is that at the stop times exp(-2)."""
    coasting = GreyBoxPredictor(DT_S, np.zeros(2), np.array([0.5, 0.5]), SPEED, SPEED)
    measured = extrapolate(coasting, machine, ONES, config())
    at_stop = SPEED * (1 - np.exp(-0.5 / 0.5))
    end, begin = (at_stop * 0.5 * np.exp(-t / 0.5) for t in (1.0, 0.8))
    np.testing.assert_allclose(measured.residual_speed_largest, (begin - end) / 0.2, rtol=1e-9)


def test_divergence_is_counted(machine):
    def explode(a):  # the first joint, when it is commanded upwards
        return np.where(a == [1.0, -2.0], np.inf, 0.0)

    measured = extrapolate(Scripted(explode), machine, ONES, config())
    # Three of nine patterns; of the eight that move, three once more.
    np.testing.assert_allclose(measured.unbounded, [(3 + 3) / (9 + 8), 0.0])
    np.testing.assert_allclose(measured.left_limits, [0.5, 0.0])
    assert np.isfinite(measured.beyond_largest).all()


def test_rollouts_of_all_kinds_of_predictors_start_from_rest(one_model, one_models_parameters):
    """Later rows are NaN, so a predictor that looked at them would show; chunks do not matter."""
    single = jax.tree.map(np.float32, one_models_parameters)
    learned = LearnedPredictor(one_model, single, has_stops=False)
    arx = fit_arx([lag_trajectory(0, 400, 0)], Target.dq, 3, DT_S, 1e-6)
    random = np.random.default_rng(0)
    starts = random.uniform(-0.5, 0.5, (300, 2))
    commands = np.repeat(random.integers(-1, 2, (300, 1, 2)), 5, axis=1).astype(float)
    for predictor in (learned, arx):
        q = simulate_from_rest(predictor, starts, commands, DT_S)
        assert q.shape == (300, 5, 2) and np.abs(q).max() < 1e5
        again = simulate_from_rest(predictor, starts[290:], commands[290:], DT_S)
        np.testing.assert_allclose(q[290:], again, atol=1e-6)
    history = one_model.initial_history(starts[7].astype(np.float32))
    stepped = one_model.step(one_models_parameters, history, commands[7, 0].astype(np.float32))
    np.testing.assert_allclose(
        simulate_from_rest(learned, starts, commands, DT_S)[7, 0], stepped.q, atol=1e-5
    )


def test_patterns():
    assert command_patterns(2, config()).shape == (9, 2)
    many = command_patterns(5, config())
    assert many.shape == (11, 5) and np.abs(many).sum(axis=1).tolist() == [1.0] * 10 + [0.0]


def test_largest_speed_is_that_of_training_rows():
    q = np.zeros((100, 2))
    q[:, 0] = 0.02 * np.arange(100)
    q[80:, 1] = np.arange(20)
    log = make_trajectory(q, q, q, n_validation=20)
    np.testing.assert_allclose(largest_speed([log], DT_S), [0.4, 0.0])


def test_mistakes_are_named():
    with pytest.raises(InputError, match="steps is 20; motion_steps and settle_steps need 30"):
        config(steps=20)
