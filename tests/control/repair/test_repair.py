"""A policy that an effect has made miss its targets learns to reach them again; small and on a fast lag model."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.network import as_policy, error_inputs, initial_layers, layers_of
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import Policy
from pipeline.control.repair.config import RepairConfig
from pipeline.control.repair.drawn_effects import DrawnEnvironment, TaskOnDraws
from pipeline.dynamics.model.network import Parameterization
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain
from pipeline.effects.draws import EffectDraws
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.store import ActiveEffects
from pipeline.effects.varying_speed import VaryingSpeed
from pipeline.errors import InputError
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics

RATIO, DEVIATION = 0.5, 0.1


@pytest.fixture(scope="module")
def effects(bobcat) -> ActiveEffects:
    setting = Setting(bobcat.dt_s, bobcat.lower, bobcat.upper, np.ones(4))
    values, off = Gain(setting).neutral(), np.zeros(4)
    values["ratio_positive"][0], off[0] = RATIO, DEVIATION
    return ActiveEffects(setting, {"gain": values}, {}, {"gain": {"ratio_positive": off}})


@pytest.fixture(scope="module")
def slower(bobcat, arm, paper_reward, effects) -> ReachingTask:
    """The swing turns one way at half the speed."""
    chain = Chain([Gain], effects.setting)
    values = jax.tree.map(jnp.float32, dict(effects.values))
    model = AugmentedModel(lag_dynamics(bobcat), chain)
    return ReachingTask(bobcat, arm, model, AugmentedParameters({}, values), paper_reward)


def test_layers_to_go_on_with_are_those_of_the_policy(environment):
    """Also of one whose observations are normalised."""
    task, random = environment.task, np.random.default_rng(0)
    n, inputs = task.observation_size, error_inputs(task, 5.0)
    layers = initial_layers(jax.random.key(0), n, [8], 4)
    mean, std = (jnp.asarray(random.uniform(0.5, 2.0, n), jnp.float32) for _ in range(2))
    policy = Policy(mean, std, layers)
    seen = jnp.asarray(random.normal(size=(5, n)), jnp.float32)
    np.testing.assert_allclose(
        as_policy(layers_of(policy, inputs), inputs).act(seen), policy.act(seen), atol=1e-5
    )


def test_every_episode_has_values_of_its_own_and_keeps_them(slower, poses, effects):
    environment = DrawnEnvironment(slower, poses, 4, 40, EffectDraws(effects).draw)
    tasks = jax.vmap(lambda key: environment.new_episode(key).task)(jax.random.split(jax.random.key(1), 64))
    ratio = tasks.history.values["gain"]["ratio_positive"]
    assert ratio.shape == (64, 4)
    np.testing.assert_array_equal(ratio[:, 1:], 1.0)
    assert abs(float(ratio[:, 0].std()) - 0.88 * DEVIATION) < 0.02  # of a normal cut off at 1.96 deviations
    after, _ = slower.hold(tasks, jnp.ones((64, 4)), 4)
    np.testing.assert_array_equal(after.history.values["gain"]["ratio_positive"], ratio)
    moved = (after.history.q - tasks.history.q)[:, 0]
    still_free = np.asarray(after.history.q[:, 0] < slower.machine.upper[0] - 1e-3)
    np.testing.assert_allclose(moved[still_free] / ratio[still_free, 0], moved[0] / ratio[0, 0], rtol=1e-4)


def test_episodes_are_compared_on_the_values_given(slower, episodes):
    """Two episodes alike but for the effect's value, under a policy that only ever says plus one."""
    last = initial_layers(jax.random.key(0), slower.observation_size, [4], 4)[-1]
    zero = jax.tree.map(jnp.zeros_like, initial_layers(jax.random.key(0), slower.observation_size, [4], 4))
    up = as_policy(
        [zero[0], last._replace(kernel=0 * last.kernel, bias=last.bias + 2.0)],
        np.eye(slower.observation_size),
    )
    pair = jax.tree.map(lambda of: np.repeat(of[:1], 2, axis=0), episodes)
    ratio = jnp.ones((2, 4)).at[0, 0].set(0.3)
    values = {"gain": {"ratio_positive": ratio, "ratio_negative": jnp.ones((2, 4))}}
    traces = evaluate_policy(up, TaskOnDraws(slower, values, jax.random.split(jax.random.key(0))), 4, 8, pair)
    moved = traces.q[:, -1] - pair.starts
    np.testing.assert_allclose(moved[0, 0] / moved[1, 0], 0.3, rtol=1e-3)
    np.testing.assert_allclose(moved[0, 1:], moved[1, 1:], rtol=1e-4)


def test_settings_are_those_of_apg_but_for_the_section(environment):
    apg, config = load_section("apg", APGConfig), load_section("policy_repair", RepairConfig)
    model = environment.task.dynamics.specification
    settings = config.apg(apg, model)
    assert (settings.training_steps, settings.horizon) == (config.training_steps, apg.horizon)
    assert not settings.between
    assert config.apg(apg, dataclasses.replace(model, parameterization=Parameterization.nfir)).between
    with pytest.raises(InputError, match=r"policy_repair\.margin is 1"):
        dataclasses.replace(config, margin=1.0)


def test_a_speed_that_varies_unseen_differs_from_episode_to_episode(bobcat, arm, paper_reward, poses):
    setting = Setting(bobcat.dt_s, bobcat.lower, bobcat.upper, np.ones(4))
    values = VaryingSpeed(setting).neutral() | {"common_std": np.full(4, 0.2), "own_std": np.zeros(4)}
    effects = ActiveEffects(setting, {"varying_speed": values}, {})
    chain = Chain([VaryingSpeed], setting)
    parameters = AugmentedParameters({}, jax.tree.map(jnp.float32, {"varying_speed": values}))
    task = ReachingTask(bobcat, arm, AugmentedModel(lag_dynamics(bobcat), chain), parameters, paper_reward)
    environment = DrawnEnvironment(task, poses, 4, 40, EffectDraws(effects).draw)
    tasks = jax.vmap(lambda key: environment.new_episode(key).task)(jax.random.split(jax.random.key(1), 200))
    z = np.asarray(tasks.history.chain["varying_speed"].mean)
    assert abs(z[:, 0].std() - 0.2) < 0.03
    np.testing.assert_array_equal(z, z[:, :1].repeat(4, axis=1))  # all of it is common
