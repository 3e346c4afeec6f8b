"""A reaching policy is learned on an identified model, and saved with what it was learned from."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pipeline.control.curve import CurvePoint, write_curve
from pipeline.control.policy import Policy, save_policy
from pipeline.control.training import PolicyTrainingConfig, TrainingResult
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.files.atomic import write_json
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes, learning_poses
from pipeline.reaching.settings import ReachingSettings

S = TypeVar("S", bound=PolicyTrainingConfig)
Train = Callable[
    [ReachingEnvironment, S, int, Episodes, Callable[[CurvePoint], None], Path | None], TrainingResult
]


@dataclass(frozen=True)
class TrainedPolicy:
    """A policy and how it was learned.

    Attributes:
        curve: Metrics at each point of the learning curve.
        metrics: Those of the point that the policy is from.
        lineage: What it was learned from.
    """

    policy: Policy
    curve: list[CurvePoint]
    metrics: dict[str, Any]
    lineage: dict[str, Any]

    def save(self, output: Path) -> None:
        """Write the policy folder."""
        save_policy(output, self.policy, self.lineage)
        write_curve(output / "curves.csv", self.curve)
        write_json(output / "metrics.json", self.metrics)


def train_policy(
    model: Path,
    reaching: ReachingSettings,
    train: Train[S],
    config: S,
    seed: int,
    progress: Callable[[CurvePoint], None] = lambda point: None,
    checkpoints: Path | None = None,
) -> TrainedPolicy:
    """Train one policy on a saved model.

    Args:
        model: Folder of the model.
        reaching: The task, and the episodes that it is learned on.
        train: `pipeline.control.ppo.train` or `pipeline.control.apg.training.train`.
        config: Its section of a profile, for this kind of model.
        seed: Of the targets and of the training.
        progress: Called with each point of the learning curve.
        checkpoints: Folder from which a killed training goes on; None: it does not.
    """
    machine, episodes = reaching.machine, reaching.episodes
    dynamics, parameters = load_dynamics(model)
    environment = ReachingEnvironment(
        reaching.task(dynamics, parameters),
        learning_poses(machine, reaching.arm, episodes, seed),
        reaching.action_repeats,
        episodes.steps,
    )
    result = train(
        environment,
        config,
        seed,
        reaching.curve_episodes(config.curve_episodes),
        progress,
        checkpoints,
    )
    kept = next(point for point in result.curve if point.steps == result.policy_steps)
    lineage = {
        "seed": seed,
        "steps": result.policy_steps,
        "machine": machine.name,
        "model": dynamics_fingerprint(model),
        "action_repeats": reaching.action_repeats,
    }
    return TrainedPolicy(
        result.policy, result.curve, {"steps": kept.steps, **kept.metrics.as_dict()}, lineage
    )
