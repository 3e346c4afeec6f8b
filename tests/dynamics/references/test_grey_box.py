"""The grey-box model against the differential equation integrated finely, and its parameters recovered."""

import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.references.grey_box import GreyBoxConfig, GreyBoxPredictor, fit_grey_box
from pipeline.errors import InputError
from tests.dynamics.conftest import make_trajectory

DT_S, FINE = 0.05, 10  # fine steps per time step; the dead times are 26 and 14 of them
DEAD_TIME_S, LAG_S = np.array([0.13, 0.07]), np.array([0.2, 0.08])
GAIN_POSITIVE, GAIN_NEGATIVE = np.array([0.3, 0.02]), np.array([0.45, 0.035])  # rad/s, m/s


def config(**changes) -> GreyBoxConfig:
    values = {
        "horizon": 40,
        "maximum_dead_time_s": 0.3,
        "minimum_lag_s": 0.02,
        "maximum_lag_s": 0.6,
        "grid_points": 8,
        "refinements": 4,
    }
    return GreyBoxConfig(**(values | changes))


def integrated(seed: int, n_rows: int, continuous: bool = False, n_validation: int = 0):
    """Rows of the model's equation; between fine steps the input is constant, and the velocity decays exactly."""
    random = np.random.default_rng(seed)
    a = np.zeros((n_rows, 2))
    for t in range(20, n_rows):
        new = random.uniform(-1, 1, 2) if continuous else random.integers(-1, 2, 2)
        a[t] = np.where(random.random(2) < 0.15, new, a[t - 1])
    gain = np.where(a > 0, GAIN_POSITIVE, GAIN_NEGATIVE) * a
    fine_s, late = DT_S / FINE, np.round(DEAD_TIME_S / DT_S * FINE).astype(int)
    decay = np.exp(-fine_s / LAG_S)
    q, qd, position, velocity = np.zeros((n_rows, 2)), np.zeros((n_rows, 2)), np.zeros(2), np.zeros(2)
    for t in range(n_rows):
        q[t], qd[t] = position, velocity
        for step in range(t * FINE, (t + 1) * FINE):
            source = np.maximum((step - late) // FINE, 0)
            drive = gain[source, [0, 1]]
            position = position + drive * fine_s + (velocity - drive) * LAG_S * (1 - decay)
            velocity = drive + (velocity - drive) * decay
    return make_trajectory(q, qd, a, n_validation=n_validation)


def test_predictions_are_those_of_the_differential_equation():
    predictor = GreyBoxPredictor(DT_S, DEAD_TIME_S, LAG_S, GAIN_POSITIVE, GAIN_NEGATIVE)
    assert predictor.rows_before == 3
    for continuous in (False, True):
        errors = prediction_errors(predictor, [integrated(1, 300, continuous)])
        assert errors.one_step_rmse.max() < 1e-12
        assert errors.open_loop_rmse_80.max() < 1e-11


@pytest.mark.parametrize("continuous", [False, True])
def test_parameters_are_recovered(continuous):
    log = integrated(2, 1200, continuous, n_validation=100)
    fitted = fit_grey_box([log], config(), DT_S)
    np.testing.assert_allclose(fitted.dead_time_s, DEAD_TIME_S, atol=0.002)
    np.testing.assert_allclose(fitted.lag_s, LAG_S, rtol=0.02)
    np.testing.assert_allclose(fitted.gain_positive, GAIN_POSITIVE, rtol=0.002)
    np.testing.assert_allclose(fitted.gain_negative, GAIN_NEGATIVE, rtol=0.002)
    errors = prediction_errors(fitted, [integrated(3, 300, continuous)])
    assert np.all(errors.open_loop_rmse_80 < 0.002 * GAIN_NEGATIVE * 4.0)


def test_only_training_rows_count():
    log = integrated(2, 500, n_validation=150)
    spoiled = make_trajectory(
        np.where(np.arange(500)[:, None] < 350, log.q, 7.0), log.qd, log.a, n_validation=150
    )
    first, second = (fit_grey_box([x], config(refinements=0), DT_S) for x in (log, spoiled))
    np.testing.assert_array_equal(first.gain_positive, second.gain_positive)


def test_a_direction_that_was_never_commanded_has_no_gain():
    log = integrated(2, 500)
    forward = make_trajectory(log.q, log.qd, np.maximum(log.a, 0.0))
    assert fit_grey_box([forward], config(refinements=0), DT_S).gain_negative.tolist() == [0.0, 0.0]


def test_mistakes_are_named():
    with pytest.raises(InputError, match="0 < minimum_lag_s < maximum_lag_s"):
        config(minimum_lag_s=0.0)
    with pytest.raises(InputError, match="47 training rows in a row"):
        fit_grey_box([integrated(0, 46)], config(), DT_S)
