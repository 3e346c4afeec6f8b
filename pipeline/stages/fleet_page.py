"""Stage `fleet_page`: the page of all watched machines, from the files that `watch` wrote."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.reporting.pages import watch
from pipeline.tracking import StageRun


@dataclass
class FleetPageStage(PipelineConfiguration):
    """Keys of `conf/fleet_page.yaml`."""

    folder: InputPath = MISSING
    output: OutputFile = MISSING


@stage(FleetPageStage)
def main(configuration: FleetPageStage, run: StageRun) -> None:
    """Write the page."""
    page = Path(configuration.output)
    watch.write(Path(configuration.folder), page)
    run.artifact(page)


if __name__ == "__main__":
    main()
