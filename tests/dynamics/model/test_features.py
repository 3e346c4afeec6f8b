"""x̃ against the NumPy reference, and its alignment."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.features import min_max
from tests.dynamics import reference
from tests.dynamics.conftest import LAGS, random_trajectory


def test_min_max_maps_limits_to_plus_and_minus_one():
    lower, upper = np.array([-2.4, 0.0]), np.array([-0.3, 0.1])
    rows = jnp.array([[-2.4, 0.0], [-0.3, 0.1], [-1.35, 0.05]])
    np.testing.assert_allclose(min_max(rows, lower, upper), [[-1, -1], [1, 1], [0, 0]], atol=1e-6)


def test_policy_features_follow_the_paper_with_commands_up_to_the_one_before(model):
    log, t = random_trajectory(1, n_rows=12), 8
    specification = model.specification
    motion = log.q if specification.target == "dq" else log.qd
    expected = reference.approximate_state(
        specification, motion[t - LAGS : t + 1], log.a[t - LAGS - 1 : t], log.q[t]
    )
    with jax.enable_x64(True):
        history = model.history_from_rows(*(jnp.asarray(rows[: t + 1]) for rows in (log.q, log.qd, log.a)))
        x = model.features(history)
    assert x.shape == (2 * 2 * (LAGS + 1) + 2,) == (specification.n_features,)
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-14)


def test_history_at_rest(model):
    q = jnp.array([[0.1, 0.2], [0.3, 0.25]])
    history = model.initial_history(q)
    at_rest = q if model.specification.target == "dq" else jnp.zeros_like(q)
    assert history.motion.shape == history.commands.shape == (2, LAGS + 1, 2)
    np.testing.assert_array_equal(history.motion, jnp.broadcast_to(at_rest[:, None], (2, LAGS + 1, 2)))
    np.testing.assert_array_equal(history.commands, 0.0)
    np.testing.assert_array_equal(history.q, q)


def test_history_needs_lags_plus_two_rows(model):
    rows = jnp.zeros((LAGS + 1, 2))
    with pytest.raises(ValueError, match=f"expected at least lags \\+ 2 = {LAGS + 2}"):
        model.history_from_rows(rows, rows, rows)
