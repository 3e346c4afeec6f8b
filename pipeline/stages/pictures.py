"""Stage `pictures`: the evaluated controllers to look at: films, paths, success rates, learning curves."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.reporting.pictures import PictureSettings, draw_pictures, save_pictures
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


@stage(PicturesStage)
def main(configuration: PicturesStage, run: StageRun) -> None:
    """Draw every controller whose evaluation is there."""
    cells, artifacts = Path(configuration.cells), Path(configuration.artifacts)
    controllers, deployments, files = read_evaluated(cells, artifacts)
    run.inputs(*files)
    shown = PictureSettings(configuration.episode, configuration.paths, configuration.frames_per_second)
    pictures = draw_pictures(configuration.machine, MACHINE_DIRECTORY, controllers, shown, deployments)
    output = Path(configuration.output)
    save_pictures(output, pictures)
    run.artifact(output, "pictures")
    if pictures.unavailable:
        print(f"pictures: no films, {pictures.unavailable}")


if __name__ == "__main__":
    main()
