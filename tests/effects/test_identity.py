"""At neutral values every wrapper, every chain and every augmented model is the identity, bit for bit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.effect import SensorEffect, VelocityEffect
from pipeline.effects.predictor import AugmentedPredictor
from pipeline.effects.store import ActiveEffects, predictor

from .conftest import SETTING, WRAPPED, make_model, random_trajectory, respond, rows

KINDS = [("mlp", "dq"), ("kan", "dqdot")]
EVERYTHING = Chain([KNOWN[family] for family in WRAPPED], SETTING)
STARTS = np.array([10, 17, 40])


@pytest.mark.parametrize("family", WRAPPED)
def test_a_wrapper_is_the_identity(family):
    effect = KNOWN[family](SETTING)
    values = jax.tree.map(lambda value: jnp.asarray(value, jnp.float32), effect.neutral())
    u, signals = rows(11, 25, proportional=KNOWN[family].needs_proportional_commands)
    if isinstance(effect, SensorEffect):
        for step in (effect.measured, effect.true):
            np.testing.assert_array_equal(step(values, jnp.asarray(signals.q)), signals.q)
        return
    inputs = u if isinstance(effect, VelocityEffect) else signals.command
    np.testing.assert_array_equal(respond(effect, values, inputs, signals), inputs)
    if isinstance(effect, VelocityEffect):
        np.testing.assert_array_equal(respond(effect, values, inputs, signals, "invert"), inputs)


@pytest.mark.parametrize("kind", KINDS, ids="_".join)
@pytest.mark.usefixtures("optimised")
def test_a_predictor_with_all_families_at_neutral_equals_one_without(kind):
    model, trajectory = make_model(*kind), random_trajectory(1)
    parameters = model.initialise(jax.random.key(0))
    bare = AugmentedPredictor(model, parameters, Chain([], SETTING), {})
    neutral = AugmentedPredictor(model, parameters, EVERYTHING, EVERYTHING.neutral())
    expected = bare.predict(trajectory, STARTS, 20)
    np.testing.assert_array_equal(neutral.predict(trajectory, STARTS, 20), expected)
    frozen = LearnedPredictor(model, parameters).predict(trajectory, STARTS, 20)
    np.testing.assert_allclose(expected, frozen, atol=2e-6)


@pytest.mark.parametrize("kind", [("kan", "dqdot"), ("nfir", "dqdot")], ids="_".join)
def test_steps_and_features_equal_those_of_the_frozen_model(kind):
    frozen = make_model(*kind)
    model = AugmentedModel(frozen, EVERYTHING)
    theta = frozen.initialise(jax.random.key(0))
    parameters = AugmentedParameters(theta, jax.tree.map(jnp.asarray, EVERYTHING.neutral()))
    q = jnp.array([[0.0, 0.2], [-0.3, 0.1], [0.2, 0.15]])
    history, expected = model.initial_history(q), frozen.initial_history(q)
    advance, advance_frozen = jax.jit(model.step), jax.jit(frozen.step)
    for command in jnp.array([[1.0, 0.0], [1.0, -1.0], [0.0, -1.0], [-1.0, 0.0]]):
        command = jnp.broadcast_to(command, q.shape)
        history, expected = advance(parameters, history, command), advance_frozen(theta, expected, command)
        for name in expected._fields:
            np.testing.assert_array_equal(getattr(history, name), getattr(expected, name))
        np.testing.assert_array_equal(model.features(history), frozen.features(expected))


def test_effects_that_are_all_neutral_give_the_frozen_models_errors():
    model, trajectory = make_model(), random_trajectory(2, 150)
    parameters = model.initialise(jax.random.key(0))
    effects = ActiveEffects(SETTING, EVERYTHING.neutral(), {"gain": {0: 0}})
    assert effects.families() == []
    for found in (predictor(model, parameters, effects), predictor(model, parameters, None)):
        assert isinstance(found, LearnedPredictor)
    errors = prediction_errors(predictor(model, parameters, effects), [trajectory])
    expected = prediction_errors(LearnedPredictor(model, parameters), [trajectory])
    np.testing.assert_array_equal(errors.one_step_rmse, expected.one_step_rmse)
    np.testing.assert_array_equal(errors.open_loop_rmse_80, expected.open_loop_rmse_80)
