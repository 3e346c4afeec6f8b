"""Dead band and saturation: small commands move nothing, full ones stay full; discrete commands cannot show it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.dead_band import DeadBand

from .conftest import SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")
VALUES = {
    "dead_band_negative": np.array([0.2, 0.0]),
    "dead_band_positive": np.array([0.5, 0.1]),
    "saturation_negative": np.array([1.0, 0.6]),
    "saturation_positive": np.array([0.7, 1.0]),
}


def test_what_is_left_of_a_command_is_as_in_the_equation():
    a = np.random.default_rng(2).uniform(-1.0, 1.0, (200, 2))
    left = respond(DeadBand(SETTING), VALUES, a)
    known = [([-1.0, -0.2, 0.5, 0.7], [-1.0, 0.0, 0.0, 1.0]), ([-0.6, 0.0, 0.1, 1.0], [-1.0, 0.0, 0.0, 1.0])]
    for joint, (commands, speeds) in enumerate(known):
        np.testing.assert_allclose(left[:, joint], np.interp(a[:, joint], commands, speeds), atol=1e-12)


def test_discrete_commands_pass_unchanged():
    a = rows(3, 80)[1].command.astype(float)
    np.testing.assert_array_equal(respond(DeadBand(SETTING), VALUES, a), a)


def test_the_derivative_beyond_the_band_is_that_of_the_equation():
    effect = DeadBand(SETTING)

    def left(band):
        values = {**effect.neutral(), "dead_band_positive": jnp.full(2, band)}
        return effect.apply(values, (), jnp.array([0.8, 0.2]))[1]

    slope = jax.jacfwd(left)(jnp.asarray(0.4))
    np.testing.assert_allclose(slope, [(0.8 - 1.0) / (1.0 - 0.4) ** 2, 0.0], atol=1e-12)


def test_no_dead_band_at_all_is_not_searched():
    grid = DeadBand(SETTING).grid()
    neutral = {name: value[0] for name, value in DeadBand(SETTING).neutral().items()}
    assert neutral not in grid
    assert {tuple(sorted(point)) for point in grid} == {tuple(sorted(VALUES))}


def test_every_saturation_that_is_searched_lies_beyond_its_band():
    for point in DeadBand(SETTING).grid():
        for direction in ("negative", "positive"):
            assert point[f"saturation_{direction}"] > point[f"dead_band_{direction}"]
