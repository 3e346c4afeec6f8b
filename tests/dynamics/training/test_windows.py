"""Windows never cross trajectories or splits, and hold the rows that they should."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.training.windows import evaluation_starts, gather_windows, stack_rows, window_starts
from pipeline.errors import InputError
from tests.dynamics.conftest import make_specification, make_trajectory, random_trajectory


def numbered(lengths_and_validation):
    """Trajectories whose values say where they are from: q = (trajectory, row)."""
    trajectories = []
    for number, (n_rows, n_validation) in enumerate(lengths_and_validation):
        rows = np.stack([np.full(n_rows, number), np.arange(n_rows)], axis=1).astype(float)
        trajectories.append(make_trajectory(rows, rows, rows, n_validation=min(n_validation, n_rows)))
    return trajectories


lengths = st.lists(st.tuples(st.integers(1, 40), st.integers(0, 15)), min_size=1, max_size=4)


@given(lengths, st.integers(0, 5), st.integers(1, 8), st.booleans())
def test_starts_are_all_windows_within_one_trajectory_and_one_split(log, lags, horizon, validation):
    trajectories = numbered(log)
    starts = window_starts(trajectories, validation, lags + 1, horizon)
    expected, offset = [], 0
    for trajectory in trajectories:
        for row in range(len(trajectory)):
            rows = range(row, row + horizon + 1)
            fits = row >= lags + 1 and rows[-1] < len(trajectory)
            if fits and all(trajectory.is_validation[r] == validation for r in rows):
                expected.append(offset + row)
        offset += len(trajectory)
    assert starts.tolist() == expected


N_ROWS = 64


@settings(deadline=None)  # compiles once per lags and horizon
@given(
    st.lists(st.integers(1, N_ROWS - 1), max_size=4, unique=True),
    st.lists(st.integers(0, 15), min_size=5, max_size=5),
    st.sampled_from([(0, 1), (2, 4), (5, 8)]),
    st.booleans(),
)
def test_windows_hold_their_rows_and_never_those_of_another_trajectory(cuts, n_validation, sizes, validation):
    """64 rows cut into up to five trajectories at any places."""
    lags, horizon = sizes
    lengths = np.diff([0, *sorted(cuts), N_ROWS])
    trajectories = numbered(zip(lengths.tolist(), n_validation, strict=False))
    starts = window_starts(trajectories, validation, lags + 1, horizon)
    padded = jnp.concatenate([jnp.asarray(starts), jnp.full(N_ROWS - len(starts), lags + 1)])
    window = jax.tree.map(np.asarray, cut_windows(lags, horizon)(stack_rows(trajectories), padded))
    for index in range(len(starts)):
        number, row = window.history.q[index].astype(int)
        assert np.sum(lengths[:number]) + row == starts[index]
        for rows, expected in (
            (window.history.motion[index], range(row - lags, row + 1)),
            (window.history.commands[index], range(row - lags - 1, row)),
            (window.commands[index], range(row, row + horizon)),
            (window.q[index], range(row + 1, row + horizon + 1)),
        ):
            np.testing.assert_array_equal(rows[:, 0], number)
            np.testing.assert_array_equal(rows[:, 1], expected)


@functools.cache
def cut_windows(lags, horizon):
    model = DynamicsModel(make_specification("mlp", "dq", lags=lags))
    return jax.jit(lambda rows, starts: gather_windows(model, rows, starts, horizon))


def test_evaluation_windows_are_fixed_by_the_seed():
    trajectories = [random_trajectory(seed, n_rows=400, n_validation=150) for seed in (0, 1)]
    starts = evaluation_starts(trajectories, horizon=80, n_windows=100, seed=5)
    assert len(np.unique(starts)) == 100
    np.testing.assert_array_equal(starts, evaluation_starts(trajectories, 80, 100, seed=5))
    assert not np.array_equal(starts, evaluation_starts(trajectories, 80, 100, seed=6))
    within = starts % 400
    assert within.min() >= 250 and within.max() + 80 < 400


def test_too_few_evaluation_windows_are_named():
    with pytest.raises(InputError, match=r"hold 20 windows of 80 steps.*asks for 21"):
        evaluation_starts([random_trajectory(0, n_rows=400, n_validation=100)], 80, 21, seed=0)
