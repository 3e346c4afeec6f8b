"""The noise's covariance is a matrix product, so that spectrum and variance are checked without sampling error."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.control.icem.noise import coloured_noise, synthesis_matrix


@given(st.integers(2, 60), st.floats(0.0, 4.0))
@settings(deadline=None, max_examples=60)
def test_every_entry_has_variance_one_and_the_covariance_depends_on_the_lag_alone(n, exponent):
    matrix = synthesis_matrix(n, exponent)
    covariance = matrix @ matrix.T
    np.testing.assert_allclose(np.diag(covariance), 1.0, atol=1e-9)
    for lag in range(n):
        np.testing.assert_allclose(np.diag(covariance, lag), covariance[0, lag], atol=1e-9)


@pytest.mark.parametrize("n", [20, 31])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 3.0])
def test_the_spectrum_falls_with_the_exponent(n, exponent):
    # E|FFT(Mz)|² of independent standard normal z is the sum of |FFT|² over the columns of M.
    power = (np.abs(np.fft.rfft(synthesis_matrix(n, exponent), axis=0)) ** 2).sum(axis=1)
    inner = slice(1, (n - 1) // 2 + 1)  # without zero and the highest frequency of an even length
    wave = np.fft.rfftfreq(n)[inner]
    slope, _ = np.polyfit(np.log(wave), np.log(power[inner]), 1)
    assert slope == pytest.approx(-exponent, abs=1e-9)
    assert power[0] == pytest.approx(power[1])  # frequency zero as the lowest one


def test_exponent_zero_is_white():
    matrix = synthesis_matrix(12, 0.0)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(12), atol=1e-12)


def test_samples_are_coloured_along_time_and_independent_across_joints():
    matrix = synthesis_matrix(8, 2.0)
    noise = np.asarray(coloured_noise(jax.random.key(0), jnp.asarray(matrix, jnp.float32), 20_000, 3))
    assert noise.shape == (20_000, 8, 3)
    covariance = np.cov(np.moveaxis(noise, 1, 2).reshape(20_000, 24).T)
    expected = np.kron(np.eye(3), matrix @ matrix.T)
    np.testing.assert_allclose(covariance, expected, atol=0.05)  # five standard errors of 20 000 samples
