"""Stage `pictures`: the evaluated controllers to look at: films, paths, success rates, learning curves."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.reporting.pictures import draw_pictures, save_pictures
from pipeline.reporting.results.deployments import read_evaluated
from pipeline.tracking import StageRun


@dataclass
class PicturesStage(PipelineConfiguration):
    """Keys of `conf/pictures.yaml`."""

    cells: InputPath = MISSING
    artifacts: InputPath = MISSING
    episode: int = MISSING
    paths: int = MISSING
    frames_per_second: int = MISSING
    output: OutputFolder = MISSING

    def __post_init__(self) -> None:
        if self.episode < 0 or self.paths < 1:
            raise InputError(
                f"episode is {self.episode}, paths {self.paths}; they count from 0 and 1 upwards"
            )
        if self.frames_per_second < 1 or self.machine.rate_hz % self.frames_per_second:
            raise InputError(
                f"frames_per_second is {self.frames_per_second}; it must divide the machine's "
                f"{self.machine.rate_hz:g} Hz"
            )


@stage(PicturesStage)
def main(configuration: PicturesStage, run: StageRun) -> None:
    """Draw every controller whose evaluation is there."""
    cells, artifacts = Path(configuration.cells), Path(configuration.artifacts)
    controllers, deployments, files = read_evaluated(cells, artifacts)
    run.inputs(*files)
    pictures = draw_pictures(
        configuration.machine,
        MACHINE_DIRECTORY,
        controllers,
        configuration.episode,
        configuration.paths,
        configuration.frames_per_second,
        deployments,
    )
    output = Path(configuration.output)
    save_pictures(output, pictures)
    run.artifact(output, "pictures")
    if pictures.unavailable:
        print(f"pictures: no films, {pictures.unavailable}")


if __name__ == "__main__":
    main()
