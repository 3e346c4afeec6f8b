"""Stage `select`: of each study's trials one is selected, by the rule that the profile states."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.study.configuration import SearchConfig
from pipeline.study.select import searched_kinds, select_kind, write_selection
from pipeline.tracking import StageRun


@dataclass
class SelectStage(PipelineConfiguration):
    """Keys of `conf/select.yaml`."""

    identify: IdentifyConfig = MISSING
    search: SearchConfig = MISSING
    searched: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(SelectStage)
def main(configuration: SelectStage, run: StageRun) -> None:
    """Select a model per searched kind and write the paper's table, ours beside the published one."""
    searched, output, search = Path(configuration.searched), Path(configuration.output), configuration.search
    degree = configuration.identify.legendre_degree
    selections = [
        select_kind(searched, kind, configuration.machine, search, degree)
        for kind in searched_kinds(searched)
    ]
    table = write_selection(output, selections, search, configuration.profile)
    for selection in selections:
        run.metrics(
            {
                f"{selection.kind}.evaluation_loss": selection.winner.evaluation_loss,
                f"{selection.kind}.n_parameters": selection.winner.n_parameters,
                f"{selection.kind}.step_time_s": selection.winner.inference_time_s,
            }
        )
    run.artifact(output, "selection")
    print(table)


if __name__ == "__main__":
    main()
