"""Metrics of made-up traces, worked out by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.machine.chain import GROUND, Surfaces
from pipeline.reaching.metrics import (
    PITCH_THRESHOLDS_RAD,
    POSITION_THRESHOLDS_M,
    Traces,
    path_lengths,
    reaching_metrics,
    success_rate,
    success_rate_matrix,
)


def traces(position_error, pitch_error, x=None, z=None, inside=None, below=None, reward=None) -> Traces:
    position_error = np.atleast_2d(np.asarray(position_error, np.float32))
    n, ticks = position_error.shape
    position = np.zeros((n, ticks, 3), np.float32)
    position[..., 0] = 0.0 if x is None else x
    position[..., 2] = 1.0 if z is None else z
    return Traces(
        q=np.zeros((n, ticks, 4), np.float32),
        command=np.zeros((n, ticks, 4), np.float32),
        start_position=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (n, 1)),
        position=position,
        position_error=position_error,
        pitch_error=np.atleast_2d(np.asarray(pitch_error, np.float32)),
        inside=np.ones((n, ticks), bool) if inside is None else np.atleast_2d(np.asarray(inside, bool)),
        below=np.zeros((n, ticks), bool) if below is None else np.atleast_2d(np.asarray(below, bool)),
        reward=np.zeros((n, ticks), np.float32) if reward is None else np.atleast_2d(np.asarray(reward)),
    )


def test_success_needs_both_conditions_at_the_same_tick():
    never_together = traces([[0.01, 0.5]], [[0.5, 0.01]])
    assert success_rate(never_together, 0.02, 0.02) == 0.0
    once = traces([[0.5, 0.01, 0.5]], [[0.5, -0.01, 0.5]])
    assert success_rate(once, 0.02, 0.02) == 1.0


def test_thresholds_are_strict_and_the_pitch_error_is_absolute():
    assert success_rate(traces([[0.125]], [[0.0]]), 0.125, 0.08) == 0.0
    assert success_rate(traces([[0.1]], [[-0.09]]), 0.12, 0.08) == 0.0
    assert success_rate(traces([[0.1]], [[-0.07]]), 0.12, 0.08) == 1.0


def test_matrix_covers_the_papers_grid():
    assert POSITION_THRESHOLDS_M[0] == 0.02 and POSITION_THRESHOLDS_M[-1] == 0.34
    assert PITCH_THRESHOLDS_RAD[0] == 0.02 and PITCH_THRESHOLDS_RAD[-1] == 0.16
    matrix = success_rate_matrix(traces([[0.05], [0.31]], [[0.03], [0.15]]))
    assert matrix.shape == (17, 8)
    assert matrix[1, 1] == 0.0  # (0.04, 0.04): 0.05 m is too far
    assert matrix[2, 0] == 0.0  # (0.06, 0.02): 0.03 rad is too much
    assert matrix[2, 1] == 0.5  # (0.06, 0.04): the first episode
    assert matrix[15, 7] == 1.0  # (0.32, 0.16): both


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_matrix_grows_with_both_thresholds_and_holds_the_reported_rates(seed):
    rng = np.random.default_rng(seed)
    made_up = traces(rng.uniform(0, 0.4, (20, 5)), rng.uniform(-0.2, 0.2, (20, 5)))
    matrix, metrics = success_rate_matrix(made_up), reaching_metrics(made_up, GROUND)
    assert (np.diff(matrix, axis=0) >= 0).all() and (np.diff(matrix, axis=1) >= 0).all()
    assert (matrix[0, 0], matrix[1, 1], matrix[5, 3]) == (
        metrics.sr_002_002,
        metrics.sr_004_004,
        metrics.sr_012_008,
    )


def test_path_ends_with_the_tick_that_reaches_the_target():
    # 1 m, 2 m, then 4 m that come after the target was reached
    reached = traces([[1.0, 0.01, 1.0]], [[0.0, 0.0, 0.0]], x=[1.0, 3.0, 7.0])
    np.testing.assert_allclose(path_lengths(reached), [3.0])
    not_precise_enough = traces([[1.0, 0.03, 1.0]], [[0.0, 0.0, 0.0]], x=[1.0, 3.0, 7.0])
    np.testing.assert_allclose(path_lengths(not_precise_enough), [7.0])
    there_and_back = traces([[1.0, 1.0, 1.0]], [[0.0, 0.0, 0.0]], x=[1.0, 0.0, 0.0])
    np.testing.assert_allclose(path_lengths(there_and_back), [2.0])


def test_rates_and_extremes_over_episodes():
    two = traces(
        [[1.0, 1.0], [1.0, 1.0]],
        [[0.0, 0.0], [0.0, 0.0]],
        z=[[1.0, 0.1], [0.5, 0.5]],
        inside=[[True, False], [True, True]],
        below=[[False, True], [False, False]],
        reward=[[1.0, 2.0], [-1.0, 0.0]],
    )
    metrics = reaching_metrics(two, GROUND)
    assert (metrics.oow, metrics.ooz, metrics.average_return) == (0.5, 0.5, 1.0)
    assert metrics.min_z_m == pytest.approx(0.1)
    assert metrics.ground == 0.0
    assert metrics.n_episodes == 2


def test_a_tip_that_lies_on_the_ground_or_would_be_in_it_counts_once_per_episode():
    """The plant's ground holds the tip at zero; the learned model knows none."""
    low = traces(
        [[1.0] * 3] * 4, [[0.0] * 3] * 4, z=[[0.3, 0.0, 0.0], [0.3, -0.1, -0.2], [0.3, 0.1, 0.3], [0.3] * 3]
    )
    assert reaching_metrics(low, GROUND).ground == 0.5


def test_a_tip_on_a_grill_or_in_the_base_counts():
    beside, above, inside, low = (0.33, 0.5), (0.0, 0.7), (-0.31, 0.5), (1.0, 0.15)
    x, z = np.transpose([beside, above, inside, low])[..., None]
    at = traces([[1.0]] * 4, [[0.0]] * 4, x=x, z=z)
    assert reaching_metrics(at, Surfaces(0.0, 0.32, 0.6)).ground == 0.25
    assert reaching_metrics(at, Surfaces(0.155, 0.32, 0.6)).ground == 0.5
