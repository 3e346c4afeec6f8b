"""APG and iCEM on a nonlinear finite-impulse-response model, of machines with other joints than the default one."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.training import Trainer
from pipeline.control.chunks import episode_keys
from pipeline.control.evaluate import controller_evaluation
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_controller
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.machine.poses import PoseConditions, PoseTable, build_pose_table
from pipeline.machine.specification import (
    CommandKind,
    JointKind,
    MachineSpecification,
    WorkspaceSpecification,
)
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.dynamics.conftest import make_fir_specification
from tests.machine.crane import crane

SPEED, LAGS, REPEATS, TICKS = 0.5, 4, 4, 40  # rad/s or m/s
UPDATES = 60

pytestmark = pytest.mark.long


def prompt_model(machine: MachineSpecification) -> tuple[FirModel, dict]:
    """Every joint moves at `SPEED` times its newest command: SiLU(x) - SiLU(-x) = x."""
    n = machine.n_joint
    model = FirModel(
        make_fir_specification(
            1.0,
            np.full(n, SPEED),
            LAGS,
            joints=list(machine.joint_names),
            hidden=[2 * n],
            position_lower=machine.lower.tolist(),
            position_upper=machine.upper.tolist(),
            demand_beyond=[1] if machine.command_kind is CommandKind.discrete else [],
        )
    )
    drawn = model.initialise(jax.random.key(0))
    both_signs = jnp.concatenate([jnp.eye(n), -jnp.eye(n)])
    first = jnp.zeros_like(drawn["layer_0"]["kernel"]).at[LAGS * n : (LAGS + 1) * n].set(both_signs.T)
    layers = [
        {"kernel": first, "bias": jnp.zeros(2 * n)},
        {"kernel": both_signs, "bias": jnp.zeros(n)},
    ]
    return model, drawn | {f"layer_{number}": layer for number, layer in enumerate(layers)}


@pytest.fixture(scope="module", params=[JointKind.revolute, JointKind.prismatic])
def task(request: pytest.FixtureRequest, paper_reward: RewardConfig) -> ReachingTask:
    """Three joints: all turn, by switched commands; or one slides, by proportional ones."""
    machine, arm = crane(request.param)
    everywhere = WorkspaceSpecification(0.01, 3.0, 3.1, -3.0, 3.0, -3.0)
    machine = dataclasses.replace(machine, workspace=everywhere)
    if request.param is JointKind.revolute:
        machine = dataclasses.replace(machine, command_kind=CommandKind.discrete)
    reward = variant_reward(paper_reward, RewardVariant.icem_double_dagger)
    return ReachingTask(machine, arm, *prompt_model(machine), reward)


@pytest.fixture(scope="module")
def poses(task: ReachingTask) -> PoseTable:
    return build_pose_table(jax.random.key(1), task.machine, task.arm, PoseConditions(3.0, None, None), 256)


def test_apg_lowers_its_cost(task: ReachingTask, poses: PoseTable) -> None:
    environment = ReachingEnvironment(task, poses, REPEATS, TICKS)
    smoke = load_section("apg", APGConfig, "smoke")
    config = dataclasses.replace(
        smoke,
        horizon=5,
        environments=32,
        hidden=[16],
        learning_rate=1e-2,
        objective=dataclasses.replace(smoke.objective, edge_weight=0.0),  # its cost is of few episodes
    )
    trainer = Trainer(environment, config, 0, UPDATES)
    _, costs = jax.jit(lambda: jax.lax.scan(trainer.update, trainer.begin(), length=UPDATES))()
    costs = np.asarray(costs)
    assert costs[-10:].mean() < 0.9 * costs[:10].mean()


def test_icem_heads_for_the_target(task: ReachingTask, poses: PoseTable) -> None:
    smoke = load_section("icem", IcemConfig, "smoke")
    config = dataclasses.replace(smoke, samples=30, elites=8)
    starts, others = np.asarray(poses.configurations[:8]).reshape(2, 4, -1)
    targets = starts + np.clip(others - starts, -0.6, 0.6)  # at most 1.2 s away at full speed
    run = controller_evaluation(icem_controller(task, config, REPEATS), task, REPEATS, TICKS)
    q = run(None, Episodes(starts, targets), episode_keys(0, 4)).traces.q
    before, after = (np.linalg.norm(of - targets, axis=-1).mean() for of in (starts, q[:, -1]))
    assert after < 0.4 * before
