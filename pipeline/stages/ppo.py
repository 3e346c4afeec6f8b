"""Stage `ppo`: a reaching policy is learned on an identified model with PPO and discretised proto-actions."""

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.configuration.stage import stage
from pipeline.configuration.training import TrainingKeys, run_training
from pipeline.control.ppo import PPOConfig, train
from pipeline.tracking import StageRun


@dataclass
class PPOStage(TrainingKeys):
    """Keys of `conf/ppo.yaml`."""

    ppo: PPOConfig = MISSING


@stage(PPOStage)
def main(configuration: PPOStage, run: StageRun) -> None:
    """Train one policy and write its folder."""
    run_training("ppo", configuration, train, configuration.ppo, run)


if __name__ == "__main__":
    main()
