"""Stage `close_loop`: from logs measured on the machine to the effect that its model lacks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from omegaconf import MISSING

from pipeline.configuration.load import ControlConfiguration
from pipeline.configuration.pages import write_page
from pipeline.configuration.paths import InputLogs, InputModel, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.families.uncorrectable import refuse_unknown
from pipeline.discrepancy.nominal_model import nominal_model
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.discrepancy.verdict.files import LoopReport, write_closed_loop, write_note
from pipeline.dynamics.judgement import seen_again
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.files.path_checks import Output
from pipeline.logs.formats.discover import is_empty_folder
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.trajectories import load_trajectories
from pipeline.tracking import StageRun
from pipeline.tracking.registry.publish import publish_closed_loop


@dataclass
class CloseLoopStage(PipelineConfiguration):
    """Keys of `conf/close_loop.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    identify: IdentifyConfig = MISSING
    close_loop: CloseLoopConfig = MISSING
    nominal: InputLogs = MISSING
    measured: InputLogs = MISSING
    output: Annotated[str, Output(replaced=("model_before", "model_after"))] = MISSING
    model: InputModel | None = None
    learned: OutputFile | None = None
    kind: str = MISSING
    allow_empty: bool = False
    page: bool = True

    def __post_init__(self) -> None:
        if isinstance(
            self.close_loop, CloseLoopConfig
        ):  # OmegaConf builds the node first and the object later
            refuse_unknown(self.close_loop.exclude)


@stage(CloseLoopStage)
def main(configuration: CloseLoopStage, run: StageRun) -> None:
    """Write `closed_loop.json`, both models, and `report.html` with the data that it is made from."""
    machine, output = configuration.machine, Path(configuration.output)
    given = None if configuration.model is None else Path(configuration.model)
    sources = configuration.nominal, configuration.measured
    if configuration.allow_empty and is_empty_folder(Path(configuration.measured)):
        say(write_note(output, machine, given, *sources))
    else:
        nominal, measured = (
            load_trajectories(Path(folder), machine, configuration.ingest, configuration.control.loop_tracker)
            for folder in sources
        )
        if (again := seen_again(nominal, measured)) is not None:
            say(
                f"caution: trajectory {again.name} of measured={configuration.measured} is among "
                f"nominal={configuration.nominal}, too; in what is the same nothing can be found"
            )
        settings = configuration.close_loop
        model = nominal_model(given, configuration.kind, nominal, machine, settings, configuration.identify)
        run.inputs(*sources)
        say(f"{len(nominal)} nominal and {len(measured)} measured trajectories")
        kept = None if configuration.learned is None else Path(configuration.learned)
        try:
            result = close_loop(nominal, measured, machine, *model, settings, say, kept=kept)
        except UnusableLogs as error:
            raise InputError(f"{error.which}={getattr(configuration, error.which)}: {error.why}") from None
        report = LoopReport(machine.name, *sources, result.evidence)
        write_closed_loop(output, result, *model, nominal, report)
        say(f"verdict {result.document['verdict']}; see {output / 'report.html'}")
        publish_closed_loop(run, output, result.document, model[0], machine.name, max(nominal, key=len))
    if configuration.page:
        write_page("closed_loop", output)
    run.artifact(output)


def say(sentence: str) -> None:
    """To the user, at once."""
    print(f"close_loop: {sentence}", flush=True)


if __name__ == "__main__":
    main()
