"""The default machine, the paper's reward and episodes, and a task on the lag model."""

import contextlib
import dataclasses
from pathlib import Path
from typing import Any

import jax
import pytest
from omegaconf import OmegaConf

from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.poses import PoseTable
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import EpisodesConfig, learning_poses
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics

CONFIGURATION = Path(__file__).parents[2] / "conf"


def section(name: str, schema: type) -> Any:
    """A section of profile `paper`, typed as Hydra would type it."""
    content = OmegaConf.load(CONFIGURATION / "profile" / "paper.yaml")[name]
    return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(schema), content))


@contextlib.contextmanager
def compiled_quickly():
    """Compile without most optimisations: these tests compile much and run little."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture(scope="package", autouse=True)
def quick_compilation():
    with compiled_quickly():
        yield


@pytest.fixture(scope="session")
def bobcat() -> MachineSpecification:
    path = CONFIGURATION / "machine" / "bobcat_e10.yaml"
    node = OmegaConf.merge(OmegaConf.structured(MachineSpecification), OmegaConf.load(path))
    machine = OmegaConf.to_object(node)
    assert isinstance(machine, MachineSpecification)
    return machine


@pytest.fixture(scope="session")
def arm(bobcat: MachineSpecification) -> Arm:
    return load_arm(bobcat, CONFIGURATION / "machine")


@pytest.fixture(scope="session")
def paper_reward() -> RewardConfig:
    return section("reward", RewardConfig)


@pytest.fixture(scope="session")
def paper_episodes() -> EpisodesConfig:
    return section("episodes", EpisodesConfig)


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
