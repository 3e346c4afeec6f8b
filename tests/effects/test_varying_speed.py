"""The filter of a varying speed: against Gaussian conditioning on all rows, and on logs of a simulated machine."""

import numpy as np
import pytest

from pipeline.effects.catalogue import IN_MODELS
from pipeline.effects.chain import Chain
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import DT_S, SETTING, signals_at
from .linear_machine import commands, linear_model, simulated

FAMILY = "varying_speed"
VALUES = {
    "common_std": np.array([0.3, 0.3]),
    "own_std": np.array([0.1, 0.2]),
    "time_constant": np.array([3.0, 3.0]),
    "noise": np.array([0.004, 0.001]),
}


def test_the_estimate_is_that_of_conditioning_on_all_rows(float64):
    random = np.random.default_rng(4)
    n_rows = 60
    time_s = DT_S * np.arange(n_rows)
    decay = np.exp(-np.abs(time_s[:, None] - time_s) / 3.0)
    of_joints = 0.3**2 + np.diag(np.square([0.1, 0.2]))
    covariance = np.kron(decay, of_joints)  # of all z, row by row
    slope = random.uniform(-0.05, 0.05, (n_rows, 2)) * (random.random((n_rows, 2)) < 0.6)
    z = np.linalg.cholesky(covariance) @ random.normal(size=2 * n_rows)
    error = slope.ravel() * z + random.normal(size=2 * n_rows) * np.tile(VALUES["noise"], n_rows)

    effect = IN_MODELS[FAMILY](SETTING)
    state = effect.initial(())
    for t in range(n_rows):
        predicted = slope[t] * np.asarray(state.mean)
        displacement = slope[t] * (1.0 + np.asarray(state.mean))
        state = effect.corrected(VALUES, state, error.reshape(-1, 2)[t] - predicted, displacement)
        filtered = state
        state, _ = effect.ratio(VALUES, state, np.zeros(2), signals_at())

    with_error = covariance[-2:] * slope.ravel()
    of_error = slope.ravel()[:, None] * covariance * slope.ravel() + np.diag(
        np.tile(VALUES["noise"] ** 2, n_rows)
    )
    np.testing.assert_allclose(filtered.mean, with_error @ np.linalg.solve(of_error, error), rtol=1e-6)
    known = with_error @ np.linalg.solve(of_error, with_error.T)
    np.testing.assert_allclose(filtered.known, known, rtol=1e-6)
    np.testing.assert_allclose(state.mean, np.exp(-DT_S / 3.0) * np.asarray(filtered.mean), rtol=1e-6)


def slow_course(t):
    return 1.0 + 0.3 * np.sin(2.0 * np.pi * DT_S * t / 40.0)


@pytest.mark.parametrize("target", ["dq", "dqdot"])
def test_what_recent_errors_show_of_a_course_is_predicted(target):
    log = simulated(commands(7, 900), on_velocity=lambda t, u, v, a, q: slow_course(t) * u)
    model, theta = linear_model(target)
    starts = np.arange(100, 860, 20)
    measured = log.q[starts[:, None] + 1 + np.arange(20)]

    def error(**changed):
        values = {
            FAMILY: VALUES | {"noise": np.array([1e-3, 3e-4]), "time_constant": np.full(2, 20.0)} | changed
        }
        predictor = AugmentedPredictor(
            model, theta, Chain([IN_MODELS[FAMILY]], SETTING), values, has_stops=False
        )
        return np.sqrt(np.mean((predictor.predict(log, starts, 20) - measured) ** 2))

    none = error(common_std=np.zeros(2), own_std=np.zeros(2))
    assert none > 3e-3
    assert error(own_std=np.zeros(2)) < 0.25 * none
    assert error(common_std=np.zeros(2)) < 0.5 * none


def test_a_joint_at_rest_shares_what_the_other_shows():
    a = np.zeros((200, 2))
    a[10:40, 0], a[40:70, 0], a[70:100, 0] = 1.0, -1.0, 1.0
    a[100:130, 1] = 1.0  # moves for the first time
    log = simulated(a, on_velocity=lambda t, u, v, a, q: 0.7 * u)
    model, theta = linear_model("dqdot")
    values = {FAMILY: VALUES | {"own_std": np.zeros(2), "time_constant": np.full(2, 60.0)}}
    predictor = AugmentedPredictor(model, theta, Chain([IN_MODELS[FAMILY]], SETTING), values, has_stops=False)
    moved = predictor.predict(log, np.array([100]), 10)[0, -1, 1] - log.q[100, 1]
    assert moved == pytest.approx(log.q[110, 1] - log.q[100, 1], rel=0.06)
