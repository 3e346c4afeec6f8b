"""Stage `search`: one worker of a hyper-parameter study; any number of them may run at once."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder, InputPath, OutputFile, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.data_split import split_by_purpose
from pipeline.study.configuration import SearchConfig
from pipeline.study.search import KindStudy, SearchedKind
from pipeline.study.storage import refuse_password
from pipeline.tracking import StageRun, progress_bar


@dataclass
class SearchStage(PipelineConfiguration):
    """Keys of `conf/search.yaml`."""

    identify: IdentifyConfig = MISSING
    search: SearchConfig = MISSING
    model: Parameterization = MISSING
    target: Target = MISSING
    tuples: InputPath = MISSING
    hold_out: list[str] = field(default_factory=list)
    n_trials: int = MISSING
    storage: OutputFile = MISSING
    checkpoints: CheckpointFolder = MISSING
    output: OutputFolder = MISSING

    def __post_init__(self) -> None:
        refuse_password(self.storage)


@stage(SearchStage)
def main(configuration: SearchStage, run: StageRun) -> None:
    """Work on the study of one model kind until its trials are finished, then write them as a table."""
    machine, output = configuration.machine, Path(configuration.output)
    rows = split_by_purpose(configuration.tuples, None, configuration.hold_out, machine)
    run.inputs(configuration.tuples)
    kind = configuration.model, configuration.target
    searched = SearchedKind(machine, configuration.identify, configuration.search, *kind, rows.learning)
    study = KindStudy(searched, configuration.storage, Path(configuration.checkpoints))
    with progress_bar(f"search {study.name}", configuration.n_trials, "trial") as bar:
        study.run(configuration.n_trials, bar.reach, run.metrics)
    ended = study.write(output)
    if study.is_finished_here:
        run.metrics(study.summary)
        run.artifact(output, "search")
    print(f"search: {len(ended)} trials of {study.name} in {output / 'trials.csv'}")


if __name__ == "__main__":
    main()
