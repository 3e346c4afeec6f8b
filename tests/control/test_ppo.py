"""Training end to end on a small scale: the curve, the kept policy, checkpoints; and that it learns at all."""

import csv
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training import acting

from pipeline.configuration.load import load_machine, load_section
from pipeline.control import ppo
from pipeline.control.apg.network import initial_layers
from pipeline.control.checkpoint import load_checkpoint
from pipeline.control.curve import write_curve
from pipeline.control.evaluate import policy_evaluation
from pipeline.control.policy import Policy
from pipeline.control.ppo import LinearDecay, ModelKindOverrides, PPOConfig, train
from pipeline.control.training import training_identity
from pipeline.control.training_state import replicated
from pipeline.control.warm_start import WarmStartConfig
from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.errors import InputError
from pipeline.machine.chain import GROUND
from pipeline.reaching.metrics import reaching_metrics
from tests.reaching.lag import model_specification

POINT = 80 * 5120  # steps between two points of the curve


def specification_of(kind: str) -> ModelSpecification:
    parameterization, target = kind.split("_")
    of_some_kind = model_specification(load_machine("bobcat_e10"), Target(target), lags=2)
    return dataclasses.replace(of_some_kind, parameterization=Parameterization(parameterization))


@pytest.fixture(scope="module")
def trained(environment, small, episodes, tmp_path_factory):
    directory = tmp_path_factory.mktemp("checkpoints")
    points = []
    return train(environment, small, 7, episodes, points.append, directory), points, directory


@pytest.mark.long
def test_curve_has_the_asked_points_and_the_kept_policy_is_of_one(trained):
    result, points, _ = trained
    # 128 sequences x 10 decisions x 4 ticks = 5120 steps a batch, 80 batches a point
    assert [point.steps for point in result.curve] == [0, POINT, 2 * POINT]
    assert points == result.curve
    assert result.policy_steps == POINT
    assert all(point.metrics.n_episodes == 16 for point in result.curve)


@pytest.mark.long
def test_a_finished_training_is_not_repeated(trained, environment, small, episodes, monkeypatch):
    monkeypatch.setattr(ppo.ppo, "train", None)  # would fail if it were called
    points = []
    again = train(environment, small, 7, episodes, points.append, trained[2])
    assert points == []
    assert again.curve == trained[0].curve
    jax.tree.map(np.testing.assert_array_equal, again.policy, trained[0].policy)


class Killed(Exception):
    pass


@pytest.mark.long
def test_an_interrupted_training_goes_on_from_its_checkpoint(
    trained, environment, small, episodes, tmp_path, monkeypatch
):
    def kill(point):
        if point.steps == POINT:
            raise Killed

    with pytest.raises(Killed):
        train(environment, small, 7, episodes, kill, tmp_path)

    points = []
    result = train(environment, small, 7, episodes, points.append, tmp_path)
    assert [point.steps for point in points] == [2 * POINT]  # what was done before is not done again
    assert result.curve == trained[0].curve  # to the last bit, after the kill as before it
    jax.tree.map(np.testing.assert_array_equal, result.policy, trained[0].policy)
    states = [
        load_checkpoint(folder, training_identity(environment, small, 7, episodes)).state
        for folder in (tmp_path, trained[2])
    ]
    jax.tree.map(np.testing.assert_array_equal, *states)  # networks, Adam's moments, episodes under way


def test_every_episode_that_ppo_learns_from_has_a_target_of_its_own(
    environment, small, episodes, monkeypatch
):
    """Brax's own collection of data, over the environment as training wraps it: ten decisions an episode."""
    handed_over = {}
    monkeypatch.setattr(ppo.ppo, "train", lambda **arguments: handed_over.update(arguments))
    with pytest.raises(AssertionError):  # nothing was trained, so nothing is kept
        train(environment, small, 7, episodes, lambda _: None, None)
    wrapped = handed_over["wrap_env_fn"](
        handed_over["environment"],
        episode_length=handed_over["episode_length"],
        action_repeat=handed_over["action_repeat"],
        randomization_fn=None,
    )
    n_environments, n_episodes = 16, 6

    def hold_still(observation, _):
        return jnp.zeros((n_environments, environment.action_size)), {}

    state = jax.jit(wrapped.reset)(jax.random.split(jax.random.PRNGKey(3), n_environments))
    collect = jax.jit(
        lambda state: acting.generate_unroll(
            wrapped, state, hold_still, jax.random.PRNGKey(0), 10 * n_episodes, ("truncation",)
        )[1]
    )
    data = collect(state)
    targets = np.asarray(data.observation[..., -4:]).reshape(-1, 4)
    n_begun = n_environments + int(data.extras["state_extras"]["truncation"].sum())
    n_seen = n_begun - int(data.extras["state_extras"]["truncation"][-1].sum())
    assert n_seen >= n_environments * n_episodes
    # drawn from a table of 4096 rows: two of a hundred may be the same one
    assert n_seen - 4 <= len(np.unique(targets, axis=0)) <= n_seen


@pytest.mark.long
def test_a_checkpoint_of_another_training_is_not_taken(trained, environment, small, episodes):
    other = training_identity(environment, dataclasses.replace(small, discount=0.9), 7, episodes)
    assert load_checkpoint(trained[2], other) is None


@pytest.mark.long
def test_learns_to_approach_the_target(trained):
    untrained, _, learned = (point.metrics.average_return for point in trained[0].curve)
    assert learned > 0.9 * untrained  # returns are negative: at least a tenth better


def test_brax_begins_with_the_policy_that_is_trained_further(environment, small, episodes, monkeypatch):
    """Its network, as Brax makes it, acts as the policy and explores with the asked deviation."""
    start = policy_of(environment, [16], seed=3)
    handed_over = {}
    monkeypatch.setattr(ppo.ppo, "train", lambda **arguments: handed_over.update(arguments))
    settings = WarmStartConfig(1000, 1e-3, 1e-4, deviation=0.2)
    config = small.from_policy(start, settings)
    with pytest.raises(AssertionError):  # nothing was trained, so nothing is kept
        train(environment, config, 7, episodes, lambda _: None, None, (start, settings.deviation))
    sizes = environment.observation_size, environment.action_size
    network = handed_over["network_factory"](*sizes)
    statistics, parameters, _ = handed_over["restore_params"]
    observations = jax.random.normal(jax.random.key(0), (50, environment.observation_size))
    outputs = network.policy_network.apply(statistics, parameters, observations)
    distribution = network.parametric_action_distribution
    np.testing.assert_allclose(distribution.mode(outputs), start.act(observations), atol=1e-5)
    np.testing.assert_allclose(distribution.create_dist(outputs).scale, 0.2 + 0.001, rtol=1e-4)
    assert not handed_over["normalize_observations"] and not handed_over["restore_value_fn"]
    assert handed_over["num_timesteps"] >= 1000


@pytest.mark.long
def test_training_further_begins_at_the_policy_and_resumes(environment, small, episodes, tmp_path):
    start = policy_of(environment, [16], seed=3)
    config = small.from_policy(start, WarmStartConfig(2 * 5120, 1e-3, 1e-4, deviation=0.2))
    result = train(environment, config, 7, episodes, lambda _: None, tmp_path, (start, 0.2))
    assert [point.steps for point in result.curve] == [0, 5120, 2 * 5120]
    assert result.policy_steps == 2 * 5120
    evaluate = policy_evaluation(environment.task, environment.action_repeats, environment.episode_ticks)
    before = reaching_metrics(evaluate(start, episodes), GROUND)
    assert result.curve[0].metrics.average_return == pytest.approx(before.average_return, rel=1e-3)
    again = train(environment, config, 7, episodes, lambda _: None, tmp_path, (start, 0.2))
    jax.tree.map(np.testing.assert_array_equal, again.policy, result.policy)
    other = policy_of(environment, [16], seed=4)
    assert training_identity(environment, config, 7, episodes, start) != training_identity(
        environment, config, 7, episodes, other
    )


def test_a_bad_warm_start_is_named():
    with pytest.raises(InputError, match=r"warm_start\.deviation is 0"):
        WarmStartConfig(1000, 1e-3, 1e-4, 0.0)


def policy_of(environment, hidden, seed):
    """Random weights and statistics."""
    keys = jax.random.split(jax.random.key(seed), 4)
    n = environment.observation_size
    layers = initial_layers(keys[0], n, hidden, environment.action_size)
    return Policy(jax.random.normal(keys[1], (n,)), 0.5 + jax.random.uniform(keys[2], (n,)), layers)


def test_linear_decay_is_a_schedule_and_an_array():
    decay = LinearDecay(1e-3, 1e-4, n_updates=100)
    np.testing.assert_allclose(decay(20), 1e-3 - 0.2 * 9e-4, rtol=1e-6)
    np.testing.assert_allclose(decay(100), 1e-4, rtol=1e-5)
    np.testing.assert_allclose(decay(500), 1e-4, rtol=1e-5)
    np.testing.assert_allclose(jnp.array(decay), 1e-3)


@pytest.mark.long
def test_curve_file_is_tidy(trained, tmp_path):
    write_curve(tmp_path / "curves.csv", trained[0].curve)
    with (tmp_path / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["steps"]) for row in rows] == [0, POINT, 2 * POINT]
    assert {"average_return", "sr_012_008", "oow"} <= set(rows[0])


def test_profile_paper_is_the_papers_table(paper_ppo):
    for kind in ("mlp_dq", "mlp_dqdot", "kan_dq"):
        chosen = paper_ppo.for_model(specification_of(kind))
        assert chosen.training_steps == 400e6
        assert chosen.evaluated_at_steps == 270e6
        assert chosen.learning_rate == chosen.final_learning_rate == 3e-4
        assert (chosen.entropy_cost, chosen.discount, chosen.clipping) == (1e-2, 0.97, 0.2)
        assert (chosen.unroll_length, chosen.batch_size, chosen.minibatches) == (40, 256, 32)
        assert (chosen.environments, chosen.updates_per_batch) == (128, 4)
        assert (chosen.policy_hidden, chosen.value_hidden) == ([256] * 4, [256] * 5)


def test_the_papers_footnote_holds_for_one_kind_of_model(paper_ppo):
    special, usual = (paper_ppo.for_model(specification_of(kind)) for kind in ("kan_dqdot", "mlp_dq"))
    changed = {"training_steps": 800e6, "evaluated_at_steps": 800e6}
    changed |= {"learning_rate": 0.8e-4, "final_learning_rate": 0.8e-4}
    assert vars(special) == vars(usual) | changed


@pytest.mark.parametrize("profile", ["default", "smoke"])
def test_the_papers_footnote_is_for_its_own_profile_only(profile):
    config = load_section("ppo", PPOConfig, profile)
    special, usual = (config.for_model(specification_of(kind)) for kind in ("kan_dqdot", "mlp_dqdot"))
    assert special == usual
    assert special.training_steps == config.training_steps


def test_overrides_of_an_unknown_kind_are_named(paper_ppo):
    with pytest.raises(InputError, match="cnn_dq"):
        dataclasses.replace(paper_ppo, model_kinds={"cnn_dq": ModelKindOverrides()})


@pytest.mark.parametrize(
    "change",
    [
        {"discount": 1.5},
        {"training_steps": 0},
        {"evaluated_at_steps": 10**9},
        {"batch_size": 3},
        {"policy_hidden": []},
    ],
)
def test_bad_configuration_is_named(paper_ppo, change):
    with pytest.raises(InputError, match=f"ppo.{next(iter(change))}"):
        PPOConfig(**{**vars(paper_ppo), **change})


def test_state_is_replicated_as_by_the_function_that_newer_jax_lacks():
    devices, state = (
        jax.local_devices(),
        {"a": jnp.arange(3.0), "b": (jnp.float32(2.0), jax.random.key_data(jax.random.key(1)))},
    )
    found, expected = replicated(state, devices), jax.device_put_replicated(state, devices)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    assert jax.tree.map(lambda leaf: leaf.devices(), found) == jax.tree.map(
        lambda leaf: leaf.devices(), expected
    )
