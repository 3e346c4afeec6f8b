"""The planner against a plain loop, with each ingredient switched off in turn, and against hand computations."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.configuration.load import load_section
from pipeline.control.icem.config import Bounds, IcemConfig
from pipeline.control.icem.noise import coloured_noise, synthesis_matrix
from pipeline.control.icem.planner import Planner, RankedPlans
from pipeline.control.icem.proposal import Proposal, refit, sample_within_bounds, shift
from pipeline.errors import InputError
from pipeline.reaching.discretise import discretise
from tests.control.icem.conftest import Quadratic
from tests.control.icem.reference import LoopPlanner

N_JOINT = 2
TARGETS = np.random.default_rng(5).uniform(
    -1.3, 1.3, (3, 5, N_JOINT)
)  # partly out of reach, so that bounds act

ABLATIONS = {
    "all": {},
    "moved on by two": {},
    "white noise": {"noise_exponent": 0.0},
    "no decay": {"sample_decay": 1.0},
    "no momentum": {"momentum": 0.0},
    "elites not kept": {"keep_elites": False},
    "elites not shifted": {"shift_elites": False},
    "mean not shifted": {"shift_mean": False},
    "mean no candidate": {"mean_in_last_iteration": False},
    "std not reset": {"reset_std": False},
    "mean executed": {"execute_best": False},
    "truncated": {"bounds": Bounds.truncate},
    "one iteration": {"iterations": 1},
}
SHIFTS = {"moved on by two": 2}  # entries per decision; else one


def planner_of(config: IcemConfig, shift: int = 1) -> Planner:
    return Planner(config, Quadratic(), lambda proto: proto, N_JOINT, shift)


def drawn(config: IcemConfig, key: jax.Array):
    """The noise that a decision draws, per iteration and for the shifted elites' last entries, and the next key."""
    synthesis = jnp.asarray(synthesis_matrix(config.horizon, config.noise_exponent), jnp.float32)
    key, iterations_key = jax.random.split(key)
    keys = list(jax.random.split(iterations_key, config.iterations))
    keys[0], shift_key = jax.random.split(keys[0])
    noises = [
        np.asarray(coloured_noise(k, synthesis, n, N_JOINT))
        for k, n in zip(keys, config.sample_counts, strict=True)
    ]
    return noises, np.asarray(coloured_noise(shift_key, synthesis, config.n_reused, N_JOINT)), key


def three_decisions(name: str, config: IcemConfig) -> list[tuple]:
    """State and command after each."""
    planner = planner_of(dataclasses.replace(config, **ABLATIONS[name]), SHIFTS.get(name, 1))
    decide = jax.jit(planner.decide)
    state, visited = planner.begin(jax.random.key(7)), []
    for target in TARGETS:
        state, command = decide(state, jnp.asarray(target, jnp.float32))
        visited.append((state, command))
    return visited


@pytest.fixture(scope="module")
def with_all_ingredients(small_icem):
    return three_decisions("all", small_icem)


@pytest.mark.parametrize("name", ABLATIONS)
def test_three_decisions_equal_the_loop(name, small_icem, with_all_ingredients):
    config, shift = dataclasses.replace(small_icem, **ABLATIONS[name]), SHIFTS.get(name, 1)
    key, loop = jax.random.key(7), LoopPlanner(config, shift, (config.horizon, N_JOINT))
    visited = with_all_ingredients if name == "all" else three_decisions(name, small_icem)
    for target, (state, command) in zip(TARGETS, visited, strict=True):
        noises, shift_noise, key = drawn(config, key)
        expected = loop.decide(lambda s, target=target: -((s - target) ** 2).sum(), noises, shift_noise)
        np.testing.assert_allclose(command, expected, atol=1e-4)
        np.testing.assert_allclose(state.elites.returns, [value for value, _ in loop.elites], atol=1e-3)
        np.testing.assert_allclose(state.elites.proto, [sequence for _, sequence in loop.elites], atol=1e-4)
        np.testing.assert_allclose(state.proposal.mean, loop.mean, atol=1e-4)
        np.testing.assert_allclose(state.proposal.std, loop.std, atol=1e-4)
    if name != "all":  # were a switch without effect, the comparison would prove nothing
        full, changed = (
            np.concatenate([np.ravel(leaf) for s, a in run for leaf in (s.proposal.mean, s.proposal.std, a)])
            for run in (with_all_ingredients, visited)
        )
        assert np.abs(full - changed).max() > 1e-3


def test_population_decays_to_twice_the_elites():
    # 500 / 1.25^i, rounded down, never below 100: computed by hand
    paper = load_section("icem", IcemConfig)
    assert paper.sample_counts == [500, 400, 320, 256, 204, 163, 131, 104, 100, 100, 100, 100]
    assert paper.sequences_per_decision == sum(paper.sample_counts) + 25
    assert paper.model_steps(action_repeats=4) == (2478 + 25) * 20 * 4


def test_the_mean_takes_a_samples_place_in_the_last_iteration_alone(small_icem):
    """With a target at the mean nothing beats it, so it leads the last elites, and only those."""
    config = dataclasses.replace(small_icem, iterations=1, shift_elites=False)
    planner = planner_of(config)
    shape = (config.horizon, N_JOINT)
    mean = jnp.full(shape, 0.25)
    state = planner.begin(jax.random.key(0))._replace(proposal=Proposal(mean, jnp.full(shape, 0.5)))
    state, command = planner.decide(state, mean)
    np.testing.assert_array_equal(state.elites.proto[0], mean)
    np.testing.assert_array_equal(command, mean[0])


def test_the_first_command_of_the_best_sequence_is_executed_not_that_of_the_mean(small_icem):
    planner = Planner(small_icem, Quadratic(), discretise, N_JOINT, 1)
    target = jnp.zeros((5, N_JOINT)).at[:, 0].set(1.0).at[:, 1].set(-1.0)
    state, command = planner.decide(planner.begin(jax.random.key(1)), target)
    np.testing.assert_array_equal(command, [1.0, -1.0])
    best = discretise(state.elites.proto[0])
    np.testing.assert_array_equal(best[0], command)


def test_places_of_elites_that_an_episode_does_not_have_yet_do_not_compete(small_icem):
    config = dataclasses.replace(small_icem, iterations=1, mean_in_last_iteration=False)
    planner = planner_of(config)
    begun = planner.begin(jax.random.key(2))
    target = jnp.zeros((5, N_JOINT))  # an empty place, all zero, would be the best of all
    state, _ = planner.decide(begun, target)
    assert np.all(np.asarray(state.elites.returns) < 0.0)
    zero = RankedPlans(jnp.zeros_like(begun.elites.proto), jnp.zeros_like(begun.elites.returns))
    state, _ = planner.decide(begun._replace(elites=zero), target)
    fresh_last_entries = np.asarray(state.elites.proto)[
        np.all(state.elites.proto[:, :-1] == 0.0, axis=(1, 2)), -1
    ]
    assert 1 <= len(fresh_last_entries) <= config.n_reused
    assert np.all(np.abs(fresh_last_entries) > 0.0)


def test_a_sequence_that_the_model_loses_itself_in_is_no_elite(small_icem):
    class Losing(Quadratic):
        def __call__(self, state, commands):
            returns = super().__call__(state, commands)
            return jnp.where(commands[:, 0, 0] > 0.0, jnp.nan, returns)

    planner = Planner(small_icem, Losing(), lambda proto: proto, N_JOINT, 1)
    state, _ = planner.decide(planner.begin(jax.random.key(1)), jnp.asarray(TARGETS[0], jnp.float32))
    assert np.all(np.isfinite(state.elites.returns))
    assert np.all(np.asarray(state.elites.proto)[:, 0, 0] <= 0.0)


@pytest.fixture(scope="module")
def decide_twice(small_icem):
    planner = Planner(small_icem, Quadratic(), discretise, N_JOINT, 2)

    @jax.jit
    def run(seed, first, second):
        state, command = planner.decide(planner.begin(jax.random.key(seed)), first)
        return planner.decide(state, second), command

    return run


@given(st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1))
@settings(deadline=None, max_examples=50)
def test_what_holds_of_every_plan(decide_twice, small_icem, seed, target_seed):
    first, second = np.random.default_rng(target_seed).uniform(-2, 2, (2, 5, N_JOINT)).astype(np.float32)
    (state, command), earlier = decide_twice(seed, first, second)
    assert set(np.concatenate([command, earlier]).tolist()) <= {-1.0, 0.0, 1.0}
    proto, returns = np.asarray(state.elites.proto), np.asarray(state.elites.returns)
    assert np.all(np.abs(proto) <= 1.0) and np.all(np.isfinite(returns))
    assert np.all(np.diff(returns) <= 0.0)  # best first
    worth = [-((np.where(np.abs(s) > 0.5, np.sign(s), 0.0) - second) ** 2).sum() for s in proto]
    np.testing.assert_allclose(returns, worth, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(state.proposal.mean[-1], state.proposal.mean[-2])  # two new entries
    np.testing.assert_array_equal(
        state.proposal.std, np.full((5, N_JOINT), small_icem.initial_std, np.float32)
    )
    once, again = (jax.tree.leaves(state), jax.tree.leaves(decide_twice(seed, first, second)[0][0]))
    for a, b in zip(once[1:], again[1:], strict=True):  # without the key
        np.testing.assert_array_equal(a, b)


def test_another_seed_is_another_plan(decide_twice):
    target = TARGETS[:2].astype(np.float32)
    (a, _), _ = decide_twice(0, *target)
    (b, _), _ = decide_twice(1, *target)
    assert not np.array_equal(a.elites.proto, b.elites.proto)


@pytest.mark.parametrize("bounds", list(Bounds))
def test_bounds(bounds):
    shape = (5000, 1, 1)
    proposal = Proposal(jnp.full(shape[1:], 0.8), jnp.full(shape[1:], 0.5))
    noise = jax.random.normal(jax.random.key(0), shape)
    samples = np.asarray(sample_within_bounds(proposal, noise, bounds)).ravel()
    assert np.all(np.abs(samples) <= 1.0)
    at_bound = (samples == 1.0).mean()
    beyond = 0.3446  # of the Gaussian: 1 - Φ(0.4)
    assert at_bound == pytest.approx(beyond, abs=0.03) if bounds is Bounds.clip else at_bound < 0.01
    if bounds is Bounds.truncate:
        # cut off -3.6 and 0.4 standard deviations from the mean: μ + σ (φ(-3.6) - φ(0.4)) / (Φ(0.4) - Φ(-3.6))
        assert samples.mean() == pytest.approx(0.8 - 0.5 * 0.3677 / 0.6553, abs=0.02)


def test_momentum_by_hand():
    old = Proposal(jnp.array([[1.0]]), jnp.array([[0.5]]))
    new = refit(old, jnp.array([[[0.0]], [[0.4]]]), momentum=0.25)
    assert float(new.mean[0, 0]) == pytest.approx(0.25 * 1.0 + 0.75 * 0.2)
    assert float(new.std[0, 0]) == pytest.approx(0.25 * 0.5 + 0.75 * 0.2)


def test_moving_on_by_hand():
    moved = shift(jnp.arange(4.0)[:, None], 1, jnp.array([[9.0]]))
    np.testing.assert_array_equal(moved[:, 0], [1.0, 2.0, 3.0, 9.0])


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"samples": 0}, "icem.samples"),
        ({"elites": 1}, "icem.elites"),
        ({"elites": 31}, "icem.elites"),
        ({"iterations": 0}, "icem.iterations"),
        ({"horizon": 1}, "icem.horizon"),
        ({"initial_std": 0.0}, "icem.initial_std"),
        ({"discount": 1.5}, "icem.discount"),
        ({"noise_exponent": -1.0}, "icem.noise_exponent"),
        ({"sample_decay": 0.5}, "icem.sample_decay"),
        ({"momentum": 1.0}, "icem.momentum"),
        ({"elite_fraction": 0.0}, "icem.elite_fraction"),
        ({"first_episodes": 0}, "icem.first_episodes"),
    ],
)
def test_a_value_out_of_range_is_named(changes, named, small_icem):
    with pytest.raises(InputError, match=named):
        dataclasses.replace(small_icem, **changes)


def test_single_ticks_move_on_by_a_decisions_ticks(small_icem):
    assert small_icem.ticks_per_entry(4) == 4 and small_icem.entries_per_decision(4) == 1
    single = dataclasses.replace(small_icem, held_entries=False)
    assert single.ticks_per_entry(4) == 1 and single.entries_per_decision(4) == 4
    with pytest.raises(InputError, match=r"icem\.horizon"):
        single.entries_per_decision(5)
