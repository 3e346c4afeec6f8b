"""Stage `ppo`: a reaching policy is learned on an identified model with PPO and discretised proto-actions."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel
from pipeline.configuration.stage import stage
from pipeline.configuration.training import TrainingKeys, run_training
from pipeline.control.policy import load_policy_of
from pipeline.control.ppo import PPOConfig, train
from pipeline.control.warm_start import WarmStartConfig
from pipeline.effects.store import load_dynamics
from pipeline.tracking import StageRun


@dataclass
class PPOStage(TrainingKeys):
    """Keys of `conf/ppo.yaml`."""

    start: InputModel | None = None
    ppo: PPOConfig = MISSING
    warm_start: WarmStartConfig = MISSING


@stage(PPOStage)
def main(configuration: PPOStage, run: StageRun) -> None:
    """Train one policy and write its folder."""
    model, ppo = Path(configuration.model), configuration.ppo
    if configuration.start is None:
        ppo = ppo.for_model(load_dynamics(model)[0].specification)
        run_training("ppo", configuration, train, ppo, run)
        return
    policy = load_policy_of(Path(configuration.start), model, configuration.machine.name)
    warm_start = configuration.warm_start
    further = partial(train, start=(policy, warm_start.deviation))
    run_training("ppo", configuration, further, ppo.from_policy(policy, warm_start), run)


if __name__ == "__main__":
    main()
