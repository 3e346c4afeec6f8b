"""Reward ablation: PPO with some terms of the reward left out (paper, appendix, table "Performance of the PPO ...").

A cell of the ablation is a set of terms and a seed. Cells are trained one after the other; a finished cell's file holds
the identity of its training, so that an interrupted ablation goes on where it stopped and a changed one starts anew.
"""

import dataclasses
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.control.checkpoint import identity
from pipeline.control.curve import CurvePoint
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.ppo import PPOConfig, train
from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import learning_poses
from pipeline.reaching.metrics import reaching_metrics
from pipeline.reaching.reward import RewardConfig, RewardTerm
from pipeline.reaching.settings import ReachingSettings


@dataclass
class RewardAblationConfig:
    """Section `reward_ablation` of a profile; all else of the training is as in section `ppo`.

    Attributes:
        rows: sets of reward terms (names of `RewardTerm`, which OmegaConf cannot nest), in the order of the table.
        seeds: of the trainings of each row.
        training_steps: as `ppo.training_steps`.
        evaluated_at_steps: as `ppo.evaluated_at_steps`.
    """

    rows: list[list[str]]
    seeds: list[int]
    training_steps: int
    evaluated_at_steps: int

    def __post_init__(self) -> None:
        unknown = sorted({term for row in self.rows for term in row} - set(RewardTerm))
        if unknown:
            raise InputError(
                f"reward_ablation.rows has {', '.join(unknown)}; a term is one of {', '.join(RewardTerm)}"
            )
        if not self.rows or not all(self.rows) or len(set(map(frozenset, self.rows))) != len(self.rows):
            raise InputError("reward_ablation.rows: list each wanted set of reward terms once, none empty")
        if not self.seeds or len(set(self.seeds)) != len(self.seeds):
            raise InputError(f"reward_ablation.seeds is {self.seeds}; list each wanted seed once")
        if not 0 < self.evaluated_at_steps <= self.training_steps:
            raise InputError(
                f"reward_ablation.evaluated_at_steps is {self.evaluated_at_steps}; it must be positive and not "
                f"above reward_ablation.training_steps ({self.training_steps})"
            )


class AblationCell(NamedTuple):
    """A training of the ablation."""

    terms: tuple[RewardTerm, ...]
    seed: int

    @property
    def name(self) -> str:
        """Place of its file below the ablation's folder, and head of its metrics' names: MLflow takes no plus sign."""
        return f"{'.'.join(self.terms)}/seed_{self.seed}"


class CellResult(NamedTuple):
    """What a cell gave: steps that its policy was trained for, and metrics over the evaluation's episodes."""

    steps: int
    metrics: dict[str, float]


@dataclass(frozen=True)
class Ablation:
    """What all cells share: the task but for its reward, the training but for its seed."""

    reaching: ReachingSettings
    dynamics: Dynamics
    parameters: Any
    fingerprint: str  # of the dynamics model and its effects
    ppo: PPOConfig

    @classmethod
    def of_model(
        cls, model: Path, reaching: ReachingSettings, ppo: PPOConfig, settings: RewardAblationConfig
    ) -> "Ablation":
        """The task on a saved model, trained by the section `ppo` for as long as the ablation's section says."""
        dynamics, parameters = load_dynamics(model, reaching.machine)
        training = dataclasses.replace(
            ppo.for_model(dynamics.specification),
            model_kinds=ppo.model_kinds,  # finished cells are known by the section as it stands
            training_steps=settings.training_steps,
            evaluated_at_steps=settings.evaluated_at_steps,
        )
        return cls(reaching, dynamics, parameters, dynamics_fingerprint(model), training)

    def rewarded(self, cell: AblationCell) -> RewardConfig:
        """The reward with the cell's terms alone."""
        return dataclasses.replace(self.reaching.reward, terms=list(cell.terms))

    def identity(self, cell: AblationCell) -> str:
        """Hash of everything that the cell's result depends on."""
        reaching = self.reaching
        settings = (reaching.machine, self.rewarded(cell), reaching.episodes, self.ppo)
        content = json.dumps([dataclasses.asdict(part) for part in settings], sort_keys=True, default=str)
        return identity(content, self.fingerprint, reaching.action_repeats, cell.seed)

    def unfinished(self, directory: Path, config: RewardAblationConfig) -> Iterator[tuple[AblationCell, str]]:
        """The cells that have no result in the ablation's folder, in order, each with its identity."""
        for cell in cells(config):
            training = self.identity(cell)
            if load_cell(directory, cell, training) is None:
                yield cell, training

    def run(
        self, cell: AblationCell, progress: Callable[[CurvePoint], None], checkpoints: Path | None
    ) -> CellResult:
        """Train the cell's policy, and evaluate it on the same fixed episodes as every controller.

        Args:
            cell: what to train.
            progress: called with every point of the learning curve.
            checkpoints: where an interrupted training goes on from, or None.
        """
        reaching, steps = self.reaching, self.reaching.episodes.steps
        task = reaching.task(self.dynamics, self.parameters, self.rewarded(cell))
        poses = learning_poses(reaching.machine, reaching.arm, reaching.episodes, cell.seed)
        environment = ReachingEnvironment(task, poses, reaching.action_repeats, steps)
        curve_episodes = reaching.curve_episodes(self.ppo.curve_episodes)
        result = train(environment, self.ppo, cell.seed, curve_episodes, progress, checkpoints)
        fixed = reaching.fixed_episodes()
        traces = evaluate_policy(result.policy, task, reaching.action_repeats, steps, fixed)
        return CellResult(result.policy_steps, reaching_metrics(traces, task.arm.surfaces).as_dict())


def terms_of(row: Sequence[str]) -> tuple[RewardTerm, ...]:
    """A row's terms."""
    return tuple(RewardTerm(term) for term in row)


def cells(config: RewardAblationConfig) -> Iterator[AblationCell]:
    """Every row's first seed before any row's second: an interrupted ablation compares all rows."""
    for seed in config.seeds:
        for row in config.rows:
            yield AblationCell(terms_of(row), seed)


def load_cell(directory: Path, cell: AblationCell, training: str) -> CellResult | None:
    """The cell's result, or None where it is not finished or of another training.

    Args:
        directory: the ablation's folder.
        cell: which.
        training: `Ablation.identity` of the cell.

    Raises:
        InputError: the file is broken.
    """
    path = directory / f"{cell.name}.json"
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["training"] != training:
            return None
        return CellResult(content["steps"], content["metrics"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: not a cell of an ablation ({error!r}); delete it to train it anew"
        ) from None


def save_cell(directory: Path, cell: AblationCell, training: str, result: CellResult) -> None:
    """Write the cell's file, whole or not at all; arguments as of `load_cell`."""
    content = {"training": training, "steps": result.steps, "metrics": result.metrics}
    write_json(directory / f"{cell.name}.json", content)


def finished(
    directory: Path, config: RewardAblationConfig, identify: Callable[[AblationCell], str]
) -> dict[tuple[RewardTerm, ...], Sequence[CellResult]]:
    """Results of the finished cells by row, in the order of rows and seeds."""
    results: dict[tuple[RewardTerm, ...], list[CellResult]] = {terms_of(row): [] for row in config.rows}
    for cell in cells(config):
        result = load_cell(directory, cell, identify(cell))
        if result is not None:
            results[cell.terms].append(result)
    return dict(results)
