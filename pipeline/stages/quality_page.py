"""Stage `quality_page`: the quality of a folder of logs as a page, from what `ingest` wrote."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.logs.ingest import read_summary
from pipeline.reporting.pages import quality
from pipeline.tracking import StageRun


@dataclass
class QualityPageStage(PipelineConfiguration):
    """Keys of `conf/quality_page.yaml`."""

    tuples: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(QualityPageStage)
def main(configuration: QualityPageStage, run: StageRun) -> None:
    """Write `quality.html`."""
    tuples, output = Path(configuration.tuples), Path(configuration.output)
    run.inputs(tuples)
    quality.write(configuration.machine, MACHINE_DIRECTORY, read_summary(tuples), tuples, output)
    run.artifact(output / quality.NAME)


if __name__ == "__main__":
    main()
