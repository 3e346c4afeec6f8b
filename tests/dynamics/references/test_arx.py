"""ARX recovers linear systems exactly."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.references.arx import fit_arx
from pipeline.errors import InputError
from tests.dynamics.conftest import lag_trajectory, make_trajectory, random_trajectory

DT_S = 0.05


@pytest.mark.parametrize("target", list(Target))
def test_linear_system_is_predicted_exactly(target):
    logs = [lag_trajectory(seed, n_rows=1000, n_validation=0) for seed in (0, 1)]
    arx = fit_arx(logs, target, lags=4, dt_s=DT_S, ridge=1e-14)
    errors = prediction_errors(arx, [lag_trajectory(7, n_rows=500, n_validation=0)])
    assert errors.one_step_rmse.max() < 1e-7
    assert errors.open_loop_rmse_80.max() < 1e-5


def test_weights_are_those_of_the_system():
    random = np.random.default_rng(0)
    a, q = random.integers(-1, 2, (3000, 2)).astype(float), np.zeros((3000, 2))
    for t in range(1, 2999):
        q[t + 1] = q[t] + 0.3 * (q[t] - q[t - 1]) + [0.02, -0.05] * a[t - 1] - 0.1 * q[t] + 0.001
    log = make_trajectory(q, np.zeros_like(q), a)
    arx = fit_arx([log], Target.dq, lags=1, dt_s=DT_S, ridge=0.0)
    weights = arx.weights[:, 0]  # q[t-1], q[t], a[t-1], a[t], and q[t] once more; of each the first joint
    np.testing.assert_allclose(weights[0], -0.3, atol=1e-6)
    np.testing.assert_allclose(weights[2] + weights[8], 0.2, atol=1e-6)
    np.testing.assert_allclose(weights[4:8], [0.02, 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(arx.intercept, 0.001, atol=1e-6)


def test_only_training_rows_count():
    log = lag_trajectory(0, n_rows=600, n_validation=200)
    spoiled = make_trajectory(
        np.where(np.arange(600)[:, None] < 400, log.q, 7.0), log.qd, log.a, n_validation=200
    )
    first, second = (fit_arx([x], Target.dq, 3, DT_S, 1e-6) for x in (log, spoiled))
    np.testing.assert_array_equal(first.weights, second.weights)


def test_too_few_rows_are_named():
    with pytest.raises(InputError, match="20 training rows in a row"):
        fit_arx([random_trajectory(0, n_rows=19)], Target.dq, 18, DT_S, 1e-6)


@pytest.mark.parametrize("target", list(Target))
def test_positions_end_at_limits(target):
    log = lag_trajectory(0, n_rows=600, n_validation=0)
    arx = fit_arx([log], target, lags=4, dt_s=DT_S, ridge=1e-12)
    starts = np.array([100, 400])
    seen = log.q[starts]
    still = np.repeat(seen[:1], len(log), axis=0)
    lower, upper = seen[0] - 0.01, seen[0] + 0.01
    free = arx.predict(replace(log, q=still), starts, 80)
    held = replace(arx, limits=(lower, upper)).predict(replace(log, q=still), starts, 80)
    assert np.all(held >= lower) and np.all(held <= upper)
    assert np.any(free < lower) or np.any(free > upper)
