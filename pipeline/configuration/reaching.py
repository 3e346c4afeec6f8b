"""Keys of every stage whose machine reaches for targets on a saved model."""

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.settings import ReachingSettings


@dataclass
class ReachingKeys(PipelineConfiguration):
    """Keys of a stage that reaches on a model."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    model: InputModel = MISSING
    output: OutputFolder = MISSING

    @property
    def reaching(self) -> ReachingSettings:
        """The task but for its model."""
        arm = load_arm(self.machine, MACHINE_DIRECTORY)
        return ReachingSettings(self.machine, arm, self.reward, self.episodes, self.control.action_repeats)
