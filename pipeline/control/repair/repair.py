"""A deployed policy is trained further on a model with effects, whose values are drawn anew for every episode."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.training import train
from pipeline.control.curve import CurvePoint
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import POLICY_FILE, Policy, load_policy, save_policy
from pipeline.control.repair.comparison import Comparison
from pipeline.control.repair.config import RepairConfig
from pipeline.control.repair.drawn_effects import DrawnEnvironment, TaskOnDraws
from pipeline.effects.draws import EffectDraws
from pipeline.effects.store import FILE, dynamics_fingerprint, load_active, load_dynamics
from pipeline.errors import InputError
from pipeline.reaching.episodes import learning_poses
from pipeline.reaching.settings import ReachingSettings
from pipeline.reaching.task import ReachingTask

# Folded into the seed's key: the values that policies are compared on are not those of the training.
_COMPARISON_STREAM = 0x636F6D70


@dataclass(frozen=True)
class Repaired:
    """A policy before and after.

    Attributes:
        former: As it was deployed.
        policy: Trained further.
        comparison: Of both, on draws of the model's effects.
        lineage: What the new one was learned from.
        is_certain: Whether the model says of no value how far it may be off.
    """

    former: Policy
    policy: Policy
    comparison: Comparison
    lineage: dict[str, Any]
    is_certain: bool

    def save(self, folder: Path) -> None:
        """Write the folder of the new policy."""
        save_policy(folder, self.policy, self.lineage)


def repair(
    policy: Path,
    model: Path,
    reaching: ReachingSettings,
    apg: APGConfig,
    config: RepairConfig,
    seed: int,
    progress: Callable[[CurvePoint], None] = lambda point: None,
) -> Repaired:
    """Train a policy further, and compare it with what it was over the same targets.

    Args:
        policy: Folder of the policy as it is deployed; it was learned on the model as it was.
        model: Folder of the model with effects, of the same window.
        apg: Section `apg` of a profile.
        config: Section `policy_repair`.
        seed: Of the training, and of the draws.
        progress: Called with the metrics before and after, on the values that are the most likely.

    Raises:
        InputError: The model has no effects, or the policy does not fit it.
    """
    dynamics, parameters = load_dynamics(model, reaching.machine)
    effects = load_active(model)
    if effects is None:
        raise InputError(f"{model}: has no effects around it; name the model_after that close_loop wrote")
    task = reaching.task(dynamics, parameters)
    former, _ = load_policy(policy, reaching.machine.name)
    check_fits(former, task, policy, model)
    draws, key = EffectDraws(effects), jax.random.key(seed)
    poses = learning_poses(reaching.machine, reaching.arm, reaching.episodes, seed)
    ticks = reaching.action_repeats, reaching.episodes.steps
    environment = DrawnEnvironment(task, poses, *ticks, draws.draw)
    settings = config.apg(apg, dynamics.specification)
    episodes = reaching.curve_episodes(apg.curve_episodes)
    result = train(environment, settings, seed, episodes, progress, None, former)
    targets = reaching.fixed_episodes(config.targets)
    of_values, hidden = jax.random.split(jax.random.fold_in(key, _COMPARISON_STREAM))
    n = len(targets.starts)
    values = jax.vmap(draws.draw)(jax.random.split(of_values, n))
    drawn = TaskOnDraws(task, values, jax.random.split(hidden, n))
    traces = [evaluate_policy(each, drawn, *ticks, targets) for each in (former, result.policy)]
    return Repaired(
        former,
        result.policy,
        Comparison.of(*traces),
        {
            "machine": reaching.machine.name,
            "action_repeats": reaching.action_repeats,
            "seed": seed,
            "steps": result.policy_steps,
            "model": dynamics_fingerprint(model),
            "start": str(policy / POLICY_FILE),
        },
        draws.is_certain,
    )


def check_fits(policy: Policy, task: ReachingTask, folder: Path, model: Path) -> None:
    """Raise `InputError` where the policy's observations are not the model's."""
    if policy.observation_size != task.observation_size or policy.action_size != task.machine.n_joint:
        raise InputError(
            f"{folder}: observes {policy.observation_size} values, {model / FILE} stands around a model of "
            f"{task.observation_size}; close the loop with model=FOLDER that the policy was learned on"
        )
