"""Fast rollouts against `ReachingTask.tick`, one tick after the other, for all four kinds of model."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.control.icem.returns import discounted, sequence_returns
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.errors import InputError
from pipeline.reaching.reward import RewardTerm
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import model_specification, random_configurations

N, DISCOUNT = 6, 0.9
# parameterization, target, lags, entries, ticks per entry: windows that fill up and that do not, held and single
CASES = [
    ("mlp", "dqdot", 5, 4, 4),
    ("mlp", "dq", 3, 7, 1),
    ("kan", "dqdot", 6, 2, 3),
    ("kan", "dq", 2, 3, 2),
]


def task_of(bobcat, arm, reward, kind, target, lags) -> ReachingTask:
    specification = dataclasses.replace(
        model_specification(bobcat, Target(target), lags),
        parameterization=Parameterization(kind),
        hidden=[6, 5],
        residual_scale=[0.1] * bobcat.n_joint,  # so that end stops and the edge of W+ are met
    )
    model = DynamicsModel(specification)
    return ReachingTask(bobcat, arm, model, model.initialise(jax.random.key(0)), reward)


def state_of(task: ReachingTask):
    """A state in motion, with commands in its history."""
    keys = jax.random.split(jax.random.key(1), 4)
    q, goal = random_configurations(task.machine, keys[0], 2)
    state = task.begin(q, goal)
    history = state.history
    motion = history.motion + 0.05 * jax.random.normal(keys[1], history.motion.shape)
    commands = jnp.sign(jax.random.normal(keys[2], history.commands.shape))
    return state._replace(history=history._replace(motion=motion, commands=commands), command=commands[-1])


def returns_by_ticks(task: ReachingTask, ticks: int, state, commands):
    """By `ReachingTask.tick`, one tick after the other."""
    first = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(commands), *jnp.shape(leaf))), state)

    def entry(state, command):
        def tick(state, _):
            state, outcome = task.tick(state, command)
            return state, outcome.reward

        return jax.lax.scan(tick, state, length=ticks)

    return discounted(jax.lax.scan(entry, first, jnp.swapaxes(commands, 0, 1))[1], DISCOUNT)


@pytest.mark.parametrize(("kind", "target", "lags", "entries", "ticks"), CASES)
def test_windows_equal_ticks(bobcat, arm, paper_reward, kind, target, lags, entries, ticks):
    task = task_of(bobcat, arm, paper_reward, kind, target, lags)
    state = state_of(task)
    commands = jnp.sign(jax.random.normal(jax.random.key(3), (N, entries, 4)))

    ways = partial(returns_by_ticks, task, ticks), sequence_returns(task, ticks, DISCOUNT)
    plain, fast = (np.asarray(jax.jit(way)(state, commands)) for way in ways)
    assert np.ptp(plain) > 0.1  # the sequences differ
    np.testing.assert_allclose(fast, plain, atol=1e-4 * entries * ticks)


def test_returns_by_hand(task):
    """The plain way: the reward of every tick, times the discount of its entry."""
    state = state_of(task)
    commands = jnp.asarray([[[1.0, 0, 0, 0], [0.0, 1, 0, -1]]])
    expected, now, tick = 0.0, state, jax.jit(task.tick)
    for entry in range(2):
        for _ in range(3):
            now, outcome = tick(now, commands[0, entry])
            expected += DISCOUNT**entry * float(outcome.reward)
    assert float(returns_by_ticks(task, 3, state, commands)[0]) == pytest.approx(expected, abs=1e-4)


def test_variants_leave_out_the_papers_terms(paper_reward):
    left = {variant: set(variant_reward(paper_reward, variant).terms) for variant in RewardVariant}
    full = set(RewardTerm)
    assert left[RewardVariant.icem] == full
    assert full - left[RewardVariant.icem_dagger] == {RewardTerm.precision}
    assert full - left[RewardVariant.icem_double_dagger] == {RewardTerm.precision, RewardTerm.pose}
    with pytest.raises(InputError, match=r"reward\.terms"):
        variant_reward(dataclasses.replace(paper_reward, terms=["pose"]), RewardVariant.icem_double_dagger)
