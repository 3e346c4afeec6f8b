"""The band of members whose velocities are known, on machines that move as told."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.evaluation.predictive_band import NORMAL_90, PredictiveBand
from pipeline.dynamics.model.fir.model import MEMBERS, FirModel
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.errors import InputError
from tests.dynamics.conftest import make_specification, make_trajectory

OFFSETS = np.array([-0.3, 0.0, 0.6])  # velocities of the members, in units of SPEED
SPEED = np.array([0.02, 0.003])
STEPS = np.arange(1, 81)[:, None]


@pytest.fixture(scope="module")
def model() -> FirModel:
    ensemble = {"members": 3, "member_hidden": [1], "demand_beyond": []}
    content = vars(make_specification("mlp", "dqdot", hidden=(1,))) | {"parameterization": "nfir"} | ensemble
    return FirModel(FirSpecification(**content, stop_lower=[None] * 2, stop_upper=[None] * 2))


@pytest.fixture(scope="module")
def parameters(model):
    """f stands still, members move by their offsets."""
    zero = jax.tree.map(jnp.zeros_like, model.initialise(jax.random.key(0)))
    zero[MEMBERS]["layer_1"]["bias"] = jnp.asarray(np.repeat(OFFSETS[:, None], 2, axis=1), jnp.float32)
    return zero


def moving(velocity, n_rows=300, n_validation=0, name="log"):
    q = np.array([-0.5, 0.1]) + 0.05 * np.arange(n_rows)[:, None] * velocity
    rest = np.zeros((n_rows, 2))
    return make_trajectory(q, rest, rest, n_validation, name)


def test_the_band_is_the_spread_and_what_remains(model, parameters):
    velocity = np.array([0.015, 0.0])  # the first joint is off by more than the spread, the second by less
    band = PredictiveBand(model, parameters, [moving(velocity, n_validation=150)])
    predicted, deviation = band.predict(moving(0.0), np.array([40, 60]))
    np.testing.assert_allclose(predicted, np.broadcast_to([-0.5, 0.1], predicted.shape), atol=1e-6)
    spread = 0.05 * STEPS * SPEED * OFFSETS.std(ddof=1)
    expected = np.maximum(spread, 0.05 * STEPS * velocity)
    np.testing.assert_allclose(deviation, np.broadcast_to(expected, deviation.shape), rtol=1e-3, atol=1e-6)


def test_coverage_counts_what_lies_within(model, parameters):
    band = PredictiveBand(model, parameters, [moving(0.0, n_validation=150)])  # whose spread explains all
    half = NORMAL_90 * SPEED * OFFSETS.std(ddof=1)
    found = band.coverage([moving(0.9 * half), moving(1.1 * half)])
    np.testing.assert_array_equal(found.share, np.full((80, 2), 0.5))
    np.testing.assert_allclose(found.width, 2.0 * 0.05 * STEPS * half, rtol=1e-3)


def test_too_little_to_measure_the_remainder_is_told(model, parameters):
    with pytest.raises(InputError, match="the band needs 80 validation rows"):
        PredictiveBand(model, parameters, [moving(0.0)])
