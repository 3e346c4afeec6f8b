"""Errors as the contract defines them, against loops over rows."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import one_step_rmse, open_loop_rmse_80, prediction_errors
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.errors import InputError
from tests.dynamics import reference
from tests.dynamics.conftest import LAGS, random_trajectory


class Drift:
    """Predicts that joint j moves by 0.01 (j+1) per step, whatever was measured."""

    rows_before = 0

    def predict(self, trajectory, starts, horizon):
        steps = np.arange(1, horizon + 1)[None, :, None] * 0.01 * np.arange(1, 3)
        return trajectory.q[starts][:, None] + steps


def test_errors_equal_loops_over_rows():
    trajectories = [
        random_trajectory(seed, n_rows) for seed, n_rows in ((0, 200), (1, 121), (2, 120), (3, 30))
    ]
    one_step, open_loop, n_steps, n_windows = [], [], 0, 0
    for log in trajectories:
        for t in range(40, len(log) - 1):
            one_step.append(log.q[t] + 0.01 * np.array([1, 2]) - log.q[t + 1])
            n_steps += 1
        s = 40
        while s + 80 < len(log):
            for h in range(1, 81):
                open_loop.append(log.q[s] + h * 0.01 * np.array([1, 2]) - log.q[s + h])
            s, n_windows = s + 20, n_windows + 1
    errors = prediction_errors(Drift(), trajectories)
    np.testing.assert_allclose(errors.one_step_rmse, np.sqrt(np.mean(np.square(one_step), axis=0)))
    np.testing.assert_allclose(errors.open_loop_rmse_80, np.sqrt(np.mean(np.square(open_loop), axis=0)))
    assert (errors.n_steps, errors.n_windows) == (n_steps, n_windows)
    assert n_windows == 4 + 1  # 40, 60, 80, 100 and 40: a window needs 81 rows from its start


def test_learned_predictor_follows_the_paper(model, parameters):
    log, starts, horizon = random_trajectory(5, n_rows=40), np.array([4, 9, 20, 31]), 5
    single = jax.tree.map(np.float32, parameters)
    predicted = LearnedPredictor(model, single, has_stops=False).predict(log, starts, horizon)
    for index, t in enumerate(starts):
        expected = reference.rollout(model.specification, single, log.q, log.qd, log.a, t, horizon)
        np.testing.assert_allclose(predicted[index], expected, rtol=0, atol=1e-5)
    assert predicted.shape == (4, horizon, 2)
    assert LearnedPredictor(model, single).rows_before == LAGS + 1


def test_joints_end_at_their_limits_or_as_far_beyond_as_they_have_been(model, parameters):
    single, horizon, starts = jax.tree.map(np.float32, parameters), 60, np.array([9, 31])
    log = random_trajectory(5, n_rows=100)
    log = replace(log, q=np.where(np.arange(100)[:, None] < 20, 0.2, 0.204) + np.zeros(2))
    limits = {"position_lower": [0.195, 0.195], "position_upper": [0.202, 0.202]}
    model = DynamicsModel(replace(model.specification, **limits))
    predicted = LearnedPredictor(model, single).predict(log, starts, horizon)
    free = LearnedPredictor(model, single, has_stops=False).predict(log, starts, horizon)
    for index, (t, upper) in enumerate(zip(starts, (0.202, 0.204), strict=True)):
        of_log = (log.q, log.qd, log.a, t, horizon)
        expected = reference.rollout(model.specification, single, *of_log, has_stops=True)
        np.testing.assert_allclose(predicted[index], expected, rtol=0, atol=1e-5)
        assert np.all(predicted[index] >= np.float32(0.195)) and np.all(predicted[index] <= np.float32(upper))
    assert np.abs(free - predicted).max() > 1e-3


def test_many_windows_are_predicted_as_few_are(one_model, one_models_parameters):
    log, starts = random_trajectory(6, n_rows=1500), np.arange(40, 1499)
    predictor = LearnedPredictor(one_model, jax.tree.map(np.float32, one_models_parameters))
    whole = predictor.predict(log, starts, 1)
    np.testing.assert_array_equal(whole[1200:1210], predictor.predict(log, starts[1200:1210], 1))


def test_models_that_need_more_history_than_is_there_are_refused():
    class LongMemory(Drift):
        rows_before = 41

    with pytest.raises(InputError, match=r"needs 41 rows of history.*at most 39 lags"):
        open_loop_rmse_80(LongMemory(), [random_trajectory(0, 200)])


def test_logs_too_short_for_a_window_are_refused():
    with pytest.raises(InputError, match="longer than 120 rows"):
        open_loop_rmse_80(Drift(), [random_trajectory(0, 120)])
    assert one_step_rmse(Drift(), [random_trajectory(0, 120)])[1] == 79


class Lost(Drift):
    def predict(self, trajectory, starts, horizon):
        predicted = super().predict(trajectory, starts, horizon)
        predicted[0, -1] = [np.nan, np.inf]
        return predicted


def test_predictions_that_are_no_numbers_count_as_large_errors():
    errors = prediction_errors(Lost(), [random_trajectory(0, 200)])
    expected = 1e6 / np.sqrt(4 * 80)  # one value in four windows of 80 steps; the others vanish beside it
    np.testing.assert_allclose(errors.open_loop_rmse_80, expected, rtol=1e-6)


def test_long_logs_are_predicted_in_parts():
    asked = []

    class Counts(Drift):
        def predict(self, trajectory, starts, horizon):
            asked.append(len(starts))
            return super().predict(trajectory, starts, horizon)

    log = random_trajectory(0, 9041)
    rmse, n_steps = one_step_rmse(Counts(), [log])
    residuals = log.q[40:-1] + 0.01 * np.array([1, 2]) - log.q[41:]
    np.testing.assert_allclose(rmse, np.sqrt(np.mean(residuals**2, axis=0)))
    assert sum(asked) == n_steps == 9000 and max(asked) <= 4096
