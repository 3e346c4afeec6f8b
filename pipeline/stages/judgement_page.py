"""Stage `judgement_page`: tables and figures of judged models, from the record that `judge` wrote."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.judged_models import RECORD
from pipeline.reporting.pages import judgement
from pipeline.tracking import StageRun


@dataclass
class JudgementPageStage(PipelineConfiguration):
    """Keys of `conf/judgement_page.yaml`."""

    folder: OutputFolder = MISSING


@stage(JudgementPageStage)
def main(configuration: JudgementPageStage, run: StageRun) -> None:
    """Write `tables`, `figures` and `comparisons.json`."""
    folder = Path(configuration.folder)
    run.inputs(folder / RECORD)
    judgement.write(folder, configuration.machine)
    for name in ("tables", "figures", "comparisons.json"):
        run.artifact(folder / name)


if __name__ == "__main__":
    main()
