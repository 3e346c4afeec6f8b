"""Sensor bias: the encoder's line and its inverse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.effects.chain import Chain
from pipeline.effects.sensor_bias import SensorBias

from .conftest import SETTING


@pytest.mark.usefixtures("float64")
def test_reading_is_scale_times_position_plus_offset():
    values = {"offset": np.array([0.1, -0.02]), "scale": np.array([1.2, 0.9])}
    effect, q = SensorBias(SETTING), np.array([[0.5, 0.2], [-1.0, 0.3]])
    np.testing.assert_allclose(effect.measured(values, q), q * [1.2, 0.9] + [0.1, -0.02], rtol=1e-12)
    np.testing.assert_allclose(effect.true(values, effect.measured(values, q)), q, rtol=1e-12)


@settings(max_examples=50, deadline=None)
@given(st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(0.7, 1.4))
def test_the_inverse_gives_the_position_back(q, offset, scale):
    values = {"offset": np.full(2, offset), "scale": np.full(2, scale)}
    effect = SensorBias(SETTING)
    np.testing.assert_allclose(
        effect.true(values, effect.measured(values, np.full(2, q))), q, rtol=1e-9, atol=1e-9
    )


def test_scale_of_displacements_is_exact():
    chain = Chain([SensorBias], SETTING)
    q = np.array([0.1, 0.3], np.float32)
    np.testing.assert_array_equal(chain.sensor_scale(chain.neutral(), q), [1.0, 1.0])
    values = {"sensor_bias": {"offset": np.zeros(2), "scale": np.array([1.25, 0.75])}}
    np.testing.assert_array_equal(chain.sensor_scale(values, q), [1.25, 0.75])


def test_the_search_tries_an_offset_or_a_scale():
    assert {tuple(point) for point in SensorBias(SETTING).grid()} == {("offset",), ("scale",)}
