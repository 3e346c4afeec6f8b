"""Stage `loop_page`: the report of a closed loop, from the files that `close_loop` wrote."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.verdict.files import DOCUMENT, REPORT_DATA
from pipeline.reporting.pages import closed_loop
from pipeline.tracking import StageRun


@dataclass
class LoopPageStage(PipelineConfiguration):
    """Keys of `conf/loop_page.yaml`."""

    folder: OutputFolder = MISSING


@stage(LoopPageStage)
def main(configuration: LoopPageStage, run: StageRun) -> None:
    """Write `report.html`, and the page of an experiment where one is planned."""
    folder = Path(configuration.folder)
    run.inputs(folder / DOCUMENT, folder / REPORT_DATA)
    closed_loop.write(folder, configuration.machine)
    run.artifact(folder / closed_loop.NAME)


if __name__ == "__main__":
    main()
