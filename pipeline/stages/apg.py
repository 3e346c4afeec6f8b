"""Stage `apg`: a reaching policy is learned along the gradient of its return through an identified model."""

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.configuration.stage import stage
from pipeline.configuration.training import TrainingKeys, run_training
from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.training import train
from pipeline.tracking import StageRun


@dataclass
class APGStage(TrainingKeys):
    """Keys of `conf/apg.yaml`."""

    apg: APGConfig = MISSING


@stage(APGStage)
def main(configuration: APGStage, run: StageRun) -> None:
    """Train one policy and write its folder."""
    run_training("apg", configuration, train, configuration.apg, run)


if __name__ == "__main__":
    main()
