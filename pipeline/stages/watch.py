"""Stage `watch`: adds a machine's new logs to a state, and says whether it is healthy or has changed."""

from dataclasses import dataclass
from functools import partial

from omegaconf import MISSING

from pipeline.configuration.load import ControlConfiguration
from pipeline.configuration.pages import write_page
from pipeline.configuration.paths import InputLogs, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.ingest_config import IngestConfig
from pipeline.tracking import StageRun
from pipeline.watch.document import metrics_of
from pipeline.watch.look import look
from pipeline.watch.settings import WatchConfig
from pipeline.watch.watch_inputs import WatchInputs, WatchSettings

say = partial(print, "watch:", flush=True)  # at once


@dataclass
class WatchStage(PipelineConfiguration):
    """Keys of `conf/watch.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    identify: IdentifyConfig = MISSING
    close_loop: CloseLoopConfig = MISSING
    watch: WatchConfig = MISSING
    nominal: InputLogs = MISSING
    sessions: InputLogs = MISSING
    state: OutputFolder = MISSING
    output: OutputFolder = MISSING
    model: InputModel | None = None
    baseline: str | None = None


@stage(WatchStage)
def main(configuration: WatchStage, run: StageRun) -> None:
    """Write `watch.json`, its page, and per change a folder as of `close_loop`."""
    told = configuration
    inputs = WatchInputs.told(told.nominal, told.sessions, told.state, told.output, told.model, told.baseline)
    sections = told.ingest, told.control.loop_tracker, told.identify, told.close_loop, told.watch
    document = look(inputs, WatchSettings(told.machine, *sections), say)
    for step, session in enumerate(document["sessions"]):
        run.metrics(metrics_of(session), step)
    write_page("watch", inputs.output, inputs.output / "watch.html")
    run.artifact(inputs.output / "watch.json")
    say(f"{document['state']}, evidence {document['e_value']:.3g} of {document['alarm_at']:g}")


if __name__ == "__main__":
    main()
