"""Derivatives with respect to the values: finite, and equal to central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.effect import SensorEffect, Signals

from .conftest import SETTING, WRAPPED, rows

STEP = 1e-5


def response(family):
    """A weighted sum of a log's outputs as a function of the values."""
    chain = Chain([KNOWN[family]], SETTING)
    proportional = KNOWN[family].needs_proportional_commands
    u, signals = jax.tree.map(
        lambda array: jnp.asarray(array, jnp.float64),
        rows(31, 40, proportional=proportional),
    )
    weights = np.random.default_rng(1).normal(size=(40, 2))

    def total(values: dict) -> jax.Array:
        command = chain.command_sequence({family: values}, signals.command)
        v, _ = chain.velocity_sequence(
            {family: values}, u, Signals(signals.command, signals.q, signals.time_s)
        )
        return jnp.sum(weights * (command + v + chain.measured({family: values}, signals.q)))

    return jax.jit(total)


@pytest.mark.parametrize("family", WRAPPED)
def test_gradients_equal_central_differences_and_are_finite_at_neutral(family, float64):
    total = response(family)
    values = float64[family]
    differentiated = jax.jit(jax.grad(total))
    at_neutral = differentiated(KNOWN[family](SETTING).neutral())
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(at_neutral))
    gradient = differentiated(values)
    for name, value in values.items():
        places = list(np.ndindex(value.shape))
        for place in [places[0], places[-1]]:
            moved = []
            for sign in (1.0, -1.0):
                changed = value.copy()
                changed[place] += sign * STEP
                moved.append(float(total({**values, name: changed})))
            expected = (moved[0] - moved[1]) / (2 * STEP)
            np.testing.assert_allclose(gradient[name][place], expected, rtol=1e-5, atol=1e-7)


def test_inverses_of_sensors_are_differentiable(float64):
    for family in WRAPPED:
        if issubclass(KNOWN[family], SensorEffect):
            effect = KNOWN[family](SETTING)
            gradient = jax.grad(lambda values, effect=effect: effect.true(values, jnp.ones(2)).sum())(
                float64[family]
            )
            assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
