"""What every training of a policy shares, by whatever method."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pipeline.control.checkpoint import Checkpoint, identity, load_checkpoint, save_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.evaluate import policy_evaluation
from pipeline.control.policy import Policy
from pipeline.errors import InputError
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import reaching_metrics


class PolicyTrainingConfig(Protocol):
    """Section of a profile for one method: `ppo` or `apg`."""

    training_steps: int
    curve_episodes: int


@dataclass(frozen=True)
class TrainingResult:
    """What a training gives.

    Attributes:
        policy: that of the point of the curve that the method keeps.
        policy_steps: steps that it was trained for.
        curve: from the untrained policy on.
    """

    policy: Policy
    policy_steps: int
    curve: list[CurvePoint]


class LearningCurve:
    """The points of a training, each of them a place to go on from after a kill.

    Attributes:
        points: so far, those of an interrupted training of the same identity included.
        resumed: the checkpoint of that training; None where there is none.
    """

    def __init__(
        self,
        method: str,
        environment: ReachingEnvironment,
        config: PolicyTrainingConfig,
        seed: int,
        episodes: Episodes,
        progress: Callable[[CurvePoint], None],
        directory: Path | None,
        start: Policy | None = None,
    ) -> None:
        """Read the checkpoint in the directory; further arguments as of `pipeline.control.ppo.train`.

        Raises:
            InputError: the checkpoint is broken.
        """
        self._method, self._progress, self._directory = method, progress, directory
        self._evaluate = policy_evaluation(
            environment.task, environment.action_repeats, environment.episode_ticks
        )
        self._episodes = episodes.first(config.curve_episodes)
        self._surfaces = environment.task.arm.surfaces
        self._training = training_identity(environment, config, seed, self._episodes, start)
        self.resumed = None if directory is None else load_checkpoint(directory, self._training)
        self.points = list(self.resumed.curve) if self.resumed else []

    def measure(self, steps: int, policy: Policy) -> None:
        """Add the point of the policy after so many steps.

        Raises:
            InputError: the training diverged.
        """
        point = CurvePoint(steps, reaching_metrics(self._evaluate(policy, self._episodes), self._surfaces))
        if not (policy.is_finite and math.isfinite(point.metrics.average_return)):
            raise InputError(
                f"{self._method}: training diverged before step {steps}; lower {self._method}.learning_rate"
            )
        self.points.append(point)

    def save(self, state: list[np.ndarray] | None, kept: tuple[Policy, int] | None) -> None:
        """Save the newest point as a checkpoint, and tell of it; arguments as of `Checkpoint`."""
        newest = self.points[-1]
        if self._directory is not None:
            checkpoint = Checkpoint(newest.steps, state, self.points, kept)
            save_checkpoint(self._directory, self._training, checkpoint)
        self._progress(newest)


def training_identity(
    environment: ReachingEnvironment,
    config: Any,
    seed: int,
    episodes: Episodes,
    start: Policy | None = None,
) -> str:
    """`checkpoint.identity` of a training: equal if and only if it would end with the same policy.

    Args:
        environment: what is learned on.
        config: hyper-parameters, a dataclass of one method.
        seed: of everything random.
        episodes: what the curve is measured over.
        start: the policy that is trained further.
    """
    task = environment.task
    return identity(
        asdict(config),
        seed,
        asdict(task.machine),
        asdict(task.dynamics.specification),
        task.parameters,
        asdict(task.reward),
        environment.poses,
        (environment.action_repeats, environment.episode_ticks),
        episodes,
        start,
    )
