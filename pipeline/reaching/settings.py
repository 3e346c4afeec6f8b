"""What every controller of a machine shares: the task but for its model, and the episodes that it is judged on."""

from dataclasses import dataclass
from typing import Any

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import Episodes, EpisodesConfig, evaluation_episodes
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask


@dataclass(frozen=True)
class ReachingSettings:
    """The reaching task of a machine.

    Attributes:
        arm: Kinematics of the machine.
        reward: Section `reward` of a profile.
        episodes: Section `episodes` of a profile.
        action_repeats: Ticks of the machine per decision.
    """

    machine: MachineSpecification
    arm: Arm
    reward: RewardConfig
    episodes: EpisodesConfig
    action_repeats: int

    def task(self, dynamics: Dynamics, parameters: Any, reward: RewardConfig | None = None) -> ReachingTask:
        """The task on a model, with another reward where one is given."""
        return ReachingTask(self.machine, self.arm, dynamics, parameters, reward or self.reward)

    def fixed_episodes(self, n: int | None = None) -> Episodes:
        """The first `n` episodes that every controller is judged on; None: all."""
        conditions = self.episodes
        episodes = evaluation_episodes(
            self.machine, self.arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
        )
        return episodes if n is None else episodes.first(n)

    def curve_episodes(self, n: int) -> Episodes:
        """Episodes for a learning curve: those that controllers are judged on decide nothing in training."""
        return evaluation_episodes(self.machine, self.arm, self.episodes, self.episodes.curve_seed, n)
