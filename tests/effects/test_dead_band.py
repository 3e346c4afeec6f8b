"""Dead band: small commands move nothing, full ones stay full; discrete commands cannot show it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.dead_band import DeadBand

from .conftest import SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")
VALUES = {"dead_band_negative": np.array([0.2, 0.0]), "dead_band_positive": np.array([0.5, 0.1])}


def test_what_is_left_of_a_command_is_as_in_the_equation():
    a = np.random.default_rng(2).uniform(-1.0, 1.0, (200, 2))
    left = respond(DeadBand(SETTING), VALUES, a)
    for joint, (negative, positive) in enumerate([(0.2, 0.5), (0.0, 0.1)]):
        for before, after in zip(a[:, joint], left[:, joint], strict=True):
            if before >= 0.0:
                expected = max(0.0, (before - positive) / (1.0 - positive))
            else:
                expected = -max(0.0, (-before - negative) / (1.0 - negative))
            assert after == pytest.approx(expected, abs=1e-12)


def test_discrete_commands_pass_unchanged():
    a = rows(3, 80)[1].command.astype(float)
    np.testing.assert_array_equal(respond(DeadBand(SETTING), VALUES, a), a)


def test_the_derivative_beyond_the_band_is_that_of_the_equation():
    effect = DeadBand(SETTING)

    def left(band):
        values = {"dead_band_negative": jnp.zeros(2), "dead_band_positive": jnp.full(2, band)}
        return effect.apply(values, (), jnp.array([0.8, 0.2]))[1]

    slope = jax.jacfwd(left)(jnp.asarray(0.4))
    np.testing.assert_allclose(slope, [(0.8 - 1.0) / (1.0 - 0.4) ** 2, 0.0], atol=1e-12)


def test_no_dead_band_at_all_is_not_searched():
    grid = DeadBand(SETTING).grid()
    assert all(max(point.values()) > 0.0 for point in grid)
    assert {tuple(sorted(point)) for point in grid} == {("dead_band_negative", "dead_band_positive")}
