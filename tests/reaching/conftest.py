"""The default machine, the paper's reward and episodes, and a task on the lag model."""

import dataclasses

import jax
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.poses import PoseTable
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import EpisodesConfig, learning_poses
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics


@pytest.fixture(scope="session")
def bobcat() -> MachineSpecification:
    return load_machine("bobcat_e10")


@pytest.fixture(scope="session")
def arm(bobcat: MachineSpecification) -> Arm:
    return load_arm(bobcat, MACHINE_DIRECTORY)


@pytest.fixture(scope="session")
def paper_reward() -> RewardConfig:
    return load_section("reward", RewardConfig)


@pytest.fixture(scope="session")
def paper_episodes() -> EpisodesConfig:
    return load_section("episodes", EpisodesConfig)


@pytest.fixture(scope="session")
def poses(bobcat: MachineSpecification, arm: Arm, paper_episodes: EpisodesConfig) -> PoseTable:
    return learning_poses(bobcat, arm, dataclasses.replace(paper_episodes, table_rows=4096), seed=0)


@pytest.fixture(scope="session")
def task(bobcat: MachineSpecification, arm: Arm, paper_reward: RewardConfig) -> ReachingTask:
    return ReachingTask(bobcat, arm, lag_dynamics(bobcat), {}, paper_reward)


@pytest.fixture(scope="session")
def forward(arm: Arm):
    return jax.jit(arm.forward)


@pytest.fixture(scope="session")
def tick(task: ReachingTask):
    return jax.jit(task.tick)


@pytest.fixture(scope="session")
def environment(task: ReachingTask, poses: PoseTable) -> ReachingEnvironment:
    """Short episodes of five decisions."""
    return ReachingEnvironment(task, poses, action_repeats=4, episode_ticks=20)


@pytest.fixture(scope="session")
def environment_step(environment: ReachingEnvironment):
    return jax.jit(environment.step)
