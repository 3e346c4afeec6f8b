"""A dependence on a measured channel, by hand, and what predictions know of the channel."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain
from pipeline.effects.dependence import OnChannel
from pipeline.effects.effect import Signals
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import PRESSURE, SETTING, make_model, random_trajectory

FAMILY = OnChannel.card.family
RISES = np.array([0.1, 0.2, -0.3, 0.4])  # from 50 to 90, 130, 170 and 210 bar


def coefficients() -> dict[str, np.ndarray]:
    """The second joint, on its way up."""
    values = OnChannel(SETTING).neutral()
    values["coefficients"][1, 1, 0] = RISES
    return values


@pytest.mark.parametrize(
    ("bar", "change"),
    [
        (120.0, 0.0),  # the usual value
        (90.0, -0.75 * 0.2),
        (70.0, -0.75 * 0.2 - 0.5 * 0.1),
        (130.0, 0.25 * 0.2),
        (190.0, 0.25 * 0.2 - 0.3 + 0.5 * 0.4),
        (500.0, 0.25 * 0.2 - 0.3 + 0.4),  # as at the range's end
        (np.nan, 0.0),
    ],
)
def test_the_ratio_follows_a_curve_over_the_channel(bar: float, change: float) -> None:
    u = jnp.array([[0.3, 0.05], [-0.3, -0.05]])
    signals = Signals(jnp.zeros((2, 2)), jnp.zeros((2, 2)), jnp.zeros(2), jnp.full((2, 1), bar))
    _, v = OnChannel(SETTING).apply(coefficients(), (), u, signals)
    np.testing.assert_allclose(v, [[0.3, 0.05 * (1.0 + change)], [-0.3, -0.05]], rtol=1e-5)


def test_a_prediction_knows_the_channel_up_to_the_windows_start() -> None:
    model, log, start = make_model(), random_trajectory(3), 40
    parameters = model.initialise(jax.random.key(0))
    predictor = AugmentedPredictor(model, parameters, Chain([OnChannel], SETTING), {FAMILY: coefficients()})

    def predicted(pressure: np.ndarray | None) -> np.ndarray:
        log.channels.clear()  # type: ignore[attr-defined]
        if pressure is not None:
            log.channels[PRESSURE.name] = pressure  # type: ignore[index]
        return predictor.predict(log, np.array([start]), 30)

    low, usual = np.full(len(log), 60.0), np.full(len(log), PRESSURE.usual)
    later = np.where(np.arange(len(log)) > start, 200.0, low)
    np.testing.assert_array_equal(predicted(later), predicted(low))
    assert np.abs(predicted(low) - predicted(usual)).max() > 1e-4
    np.testing.assert_array_equal(predicted(None), predicted(usual))


def test_a_channel_is_expected_to_return_to_its_usual_value() -> None:
    setting = replace(SETTING, channels=(PRESSURE._replace(kept=0.5),))
    model = AugmentedModel(make_model(), Chain([OnChannel], setting))
    parameters = AugmentedParameters(model.frozen.initialise(jax.random.key(0)), {FAMILY: coefficients()})
    history = model.initial_history(jnp.array([0.0, 0.2]))
    np.testing.assert_allclose(history.channels, [PRESSURE.usual])
    history = history._replace(channels=jnp.array([200.0]))
    for _ in range(20):  # a second
        history = model.step(parameters, history, jnp.zeros(2))
    np.testing.assert_allclose(history.channels, [PRESSURE.usual + 0.5 * (200.0 - PRESSURE.usual)], rtol=1e-5)
