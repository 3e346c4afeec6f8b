"""What every training of a policy shares, by whatever method."""

from dataclasses import asdict, dataclass
from typing import Any

from pipeline.control.checkpoint import identity
from pipeline.control.curve import CurvePoint
from pipeline.control.policy import Policy
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes


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


def training_identity(environment: ReachingEnvironment, config: Any, seed: int, episodes: Episodes) -> str:
    """`checkpoint.identity` of a training: equal if and only if it would end with the same policy.

    Args:
        environment: what is learned on.
        config: hyper-parameters, a dataclass of one method.
        seed: of everything random.
        episodes: what the curve is measured over.
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
    )
