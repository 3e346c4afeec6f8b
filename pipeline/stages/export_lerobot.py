"""Stage `export_lerobot`: tuples become a LeRobot dataset, one episode per trajectory."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import counted
from pipeline.logs.export.lerobot import write_lerobot
from pipeline.logs.tuples import read_tuples
from pipeline.tracking import StageRun


@dataclass
class ExportLeRobotStage(PipelineConfiguration):
    """Keys of `conf/export_lerobot.yaml`."""

    tuples: InputPath = MISSING
    output: OutputFolder = MISSING
    task: str = MISSING


@stage(ExportLeRobotStage)
def main(configuration: ExportLeRobotStage, run: StageRun) -> None:
    """Write the dataset."""
    output, machine = Path(configuration.output), configuration.machine
    trajectories = read_tuples(Path(configuration.tuples), machine)
    n_episodes = write_lerobot(output, machine, trajectories, configuration.task)
    print(f"export_lerobot: {output}: {counted(n_episodes, 'episode')}")
    run.artifact(output, "dataset")


if __name__ == "__main__":
    main()
