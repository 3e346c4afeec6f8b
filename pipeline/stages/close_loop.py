"""Stage `close_loop`: from logs measured on the machine to the effect that its model lacks."""

from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Annotated

from omegaconf import MISSING

from pipeline.configuration.load import ControlConfiguration
from pipeline.configuration.pages import write_page
from pipeline.configuration.paths import InputLogFolders, InputLogs, InputModel, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.from_logs import LoopInputs, close_loop_on_logs
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.files.path_checks import Output
from pipeline.logs.ingest_config import IngestConfig
from pipeline.tracking import StageRun
from pipeline.tracking.registry.publish import publish_closed_loop

say = partial(print, "close_loop:", flush=True)  # at once


@dataclass
class CloseLoopStage(PipelineConfiguration):
    """Keys of `conf/close_loop.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    identify: IdentifyConfig = MISSING
    close_loop: CloseLoopConfig = MISSING
    nominal: InputLogs = MISSING
    measured: InputLogFolders | None = None
    output: Annotated[str, Output(replaced=("model_before", "model_after"))] = MISSING
    model: InputModel | None = None
    learned: OutputFile | None = None
    kind: str = MISSING
    allow_empty: bool = False
    page: bool = True


@stage(CloseLoopStage)
def main(configuration: CloseLoopStage, run: StageRun) -> None:
    """Write `closed_loop.json`, both models, and `report.html` with the data that it is made from."""
    machine, output = configuration.machine, Path(configuration.output)
    inputs = LoopInputs(**{field.name: getattr(configuration, field.name) for field in fields(LoopInputs)})
    settings = configuration.ingest, configuration.control.loop_tracker, configuration.identify
    closed = close_loop_on_logs(inputs, output, machine, *settings, configuration.close_loop, say)
    if closed is not None:
        run.inputs(*inputs.folders)
        publish_closed_loop(run, output, *closed, machine.name)
    if configuration.page:
        write_page("closed_loop", output, machine)
        say(f"see {output / 'report.html'}")
    run.artifact(output)


if __name__ == "__main__":
    main()
