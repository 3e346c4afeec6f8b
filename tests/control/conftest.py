"""A reaching task on a fast lag model, small enough to learn on in seconds."""

import pytest

from pipeline.configuration.load import load_section
from pipeline.control.ppo import PPOConfig
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes, evaluation_episodes
from tests.reaching.conftest import (  # noqa: F401  fixtures
    arm,
    bobcat,
    paper_episodes,
    paper_reward,
    poses,
    task,
)


@pytest.fixture(scope="session")
def paper_ppo() -> PPOConfig:
    return load_section("ppo", PPOConfig)


@pytest.fixture(scope="session")
def small() -> PPOConfig:
    """Seconds of training: two points of 80 batches of 128 sequences of ten decisions."""
    return PPOConfig(
        training_steps=2 * 80 * 5120,
        evaluated_at_steps=80 * 5120,
        learning_rate=3e-3,
        final_learning_rate=3e-4,
        entropy_cost=1e-3,
        discount=0.97,
        gae_lambda=0.95,
        unroll_length=10,
        clipping=0.2,
        batch_size=32,
        minibatches=4,
        updates_per_batch=4,
        environments=128,
        staggered_episodes=True,
        policy_hidden=[32, 32],
        value_hidden=[32, 32],
        normalize_observations=True,
        reward_scaling=0.1,
        curve_points=2,
        curve_episodes=16,
    )


@pytest.fixture(scope="session")
def environment(task, poses) -> ReachingEnvironment:  # noqa: F811
    return ReachingEnvironment(task, poses, action_repeats=4, episode_ticks=40)


@pytest.fixture(scope="session")
def episodes(bobcat, arm, paper_episodes) -> Episodes:  # noqa: F811
    return evaluation_episodes(bobcat, arm, paper_episodes, seed=0, n=16)
