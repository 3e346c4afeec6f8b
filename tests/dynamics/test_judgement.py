"""Judgement of several predictors: on the same rows, by name, on rows that were not learned from."""

import numpy as np
import pytest

from pipeline.dynamics.evaluation.error_growth import ErrorGrowthConfig, error_growth
from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.evaluation.extrapolation import ExtrapolationConfig, extrapolate, largest_speed
from pipeline.dynamics.judgement import (
    JudgeConfig,
    check_unseen,
    flat_metrics,
    judge,
    judge_fully,
    long_prediction,
    seen_twice,
)
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.references.all_references import ArxConfig, fit_references
from pipeline.dynamics.references.arx import fit_arx
from pipeline.dynamics.references.grey_box import GreyBoxConfig
from pipeline.dynamics.references.narx import NarxConfig
from pipeline.errors import InputError

from .conftest import lag_trajectory, make_trajectory

DT_S = 0.05
ARX = ArxConfig(lags=3, ridge=1e-12)
NARX = NarxConfig(Target.dq, [0], [1, 2, 3], maximum_terms=4, maximum_rows=2000, simulation_horizon=20)
GREY_BOX = GreyBoxConfig(
    horizon=20, maximum_dead_time_s=0.2, minimum_lag_s=0.1, maximum_lag_s=0.4, grid_points=5, refinements=2
)
GROWTH = ErrorGrowthConfig(horizon=60, stride=10, resamples=50, confidence=0.9, seed=0)
EXTRAPOLATION = ExtrapolationConfig(
    seed=0, configurations=2, steps=60, motion_steps=10, settle_steps=20, all_combinations_up_to_joints=2
)
CONFIG = JudgeConfig(100, ARX, NARX, GREY_BOX, GROWTH, EXTRAPOLATION)


@pytest.fixture(scope="module")
def held_out():
    log = lag_trajectory(9, n_rows=400, n_validation=0)
    return [make_trajectory(log.q, log.qd, log.a, name="other")]


@pytest.fixture(scope="module")
def arx(lag_trajectories):
    return {target: fit_arx(lag_trajectories, target, 3, DT_S, 1e-12) for target in Target}


def test_references_know_a_linear_axis(lag_trajectories, held_out, machine):
    """All four can represent a first-order lag with a dead time of two steps, the grey box only nearly: its
    speed changes within a step."""
    references = vars(fit_references(lag_trajectories, machine, ARX, NARX, GREY_BOX))
    assert list(references) == ["arx_dq", "arx_dqdot", "narx", "grey_box"]
    for name, reference in references.items():
        errors = prediction_errors(reference, held_out)
        assert errors.open_loop_rmse_80.max() < (0.01 if name == "grey_box" else 1e-6), name


def test_every_part_is_measured_as_it_is_alone(arx, lag_trajectories, held_out, machine):
    done = []
    judgements = judge_fully(
        {"a": arx[Target.dq], "b": arx[Target.dqdot]},
        lag_trajectories,
        held_out,
        machine,
        CONFIG,
        done.append,
    )
    assert done == ["a", "b"] == list(judgements)
    for name, target in (("a", Target.dq), ("b", Target.dqdot)):
        one, predictor = judgements[name], arx[target]
        expected = extrapolate(predictor, machine, largest_speed(lag_trajectories, DT_S), EXTRAPOLATION)
        np.testing.assert_array_equal(
            one.errors.one_step_rmse, prediction_errors(predictor, held_out).one_step_rmse
        )
        np.testing.assert_array_equal(one.growth.rmse, error_growth(predictor, held_out, GROWTH).rmse)
        for quantity, values in vars(expected).items():
            np.testing.assert_array_equal(getattr(one.extrapolation, quantity), values)
        assert len(one.open_loop.t_s) == 100
    metrics = flat_metrics(judgements, machine)
    assert metrics["b.open_loop_rmse_80.turn"] == judgements["b"].errors.open_loop_rmse_80[1]
    assert metrics["a.rmse_after_60_steps.lift"] == judgements["a"].growth.rmse[-1, 0]
    assert metrics["a.drift_at_rest.turn"] == judgements["a"].extrapolation.drift_at_rest[1]
    assert (metrics["n_steps"], metrics["n_windows"]) == (359, 14)
    assert all(isinstance(value, int | float) and np.isfinite(value) for value in metrics.values())


def test_judge_names_predictors_and_joints(arx, held_out, machine):
    metrics = judge({"model": arx[Target.dq]}, held_out, machine)
    assert set(metrics) == {"model", "n_windows", "n_steps"}
    assert list(metrics["model"]["one_step_rmse"]) == ["lift", "turn"]


def test_long_prediction_is_of_the_longest_trajectory(arx, lag_trajectories):
    short, long = lag_trajectory(5, 100, 0), lag_trajectory(6, 300, 0)
    prediction = long_prediction(arx[Target.dq], [short, long], 40, 1000)
    assert prediction.trajectory == "lag6" and len(prediction.t_s) == 259
    np.testing.assert_array_equal(prediction.measured, long.q[41:])
    np.testing.assert_array_equal(prediction.commands, long.a[40:-1])
    np.testing.assert_allclose(prediction.predicted, long.q[41:], atol=1e-6)


def test_rows_that_were_learned_from_are_refused():
    first, second = (
        lag_trajectory(0, 100, 0),
        lag_trajectory(1, 100, 0),
    )  # at equal times, from one rest position
    check_unseen([first], [second])
    renamed = make_trajectory(first.q, first.qd, first.a, name="renamed")
    with pytest.raises(InputError, match="held_out: trajectory renamed was learned from"):
        check_unseen([second, first], [renamed])
    later = make_trajectory(first.q, first.qd, first.a)
    later.stamp_ns[:] += 10**12
    check_unseen([first], [later])


def test_a_recording_that_is_there_twice_is_found_whatever_its_name_and_place():
    first, second = lag_trajectory(0, 100, 0), lag_trajectory(1, 100, 0)
    renamed = make_trajectory(first.q, first.qd, first.a, name="renamed")
    assert seen_twice([]) is None and seen_twice([first, second]) is None
    assert seen_twice([first, second, renamed]) is renamed
    assert seen_twice([second, renamed, first]) is first
