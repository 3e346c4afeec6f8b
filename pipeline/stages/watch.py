"""Stage `watch`: adds a machine's new logs to a state, and says whether it is healthy or has changed."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import ControlConfiguration
from pipeline.configuration.paths import InputLogs, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.ingest_config import IngestConfig
from pipeline.tracking import StageRun
from pipeline.watch.look import look
from pipeline.watch.settings import WatchConfig
from pipeline.watch.watch_inputs import WatchInputs, WatchSettings, stamp_of

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
    """Write `watch.json`, and per change a folder as of `close_loop`."""
    nominal, sessions = Path(configuration.nominal), Path(configuration.sessions)
    model, baseline = configuration.model, configuration.baseline
    inputs = WatchInputs(
        nominal,
        sessions,
        state=Path(configuration.state),
        output=Path(configuration.output),
        model=Path(model) if model else None,
        baseline_ns=stamp_of(baseline) if baseline else None,
    )
    ingest, tracker = configuration.ingest, configuration.control.loop_tracker
    sections = configuration.identify, configuration.close_loop, configuration.watch
    settings = WatchSettings(configuration.machine, ingest, tracker, *sections)
    document = look(inputs, settings, say)
    for step, session in enumerate(document["sessions"]):
        values = {f"e_value.{joint}": of["e_value"] for joint, of in session["joints"].items()}
        run.metrics({"e_value": session["e_value"], **values}, step)
    run.artifact(inputs.output / "watch.json")
    say(f"{document['state']}, evidence {document['e_value']:.3g} of {document['alarm_at']:g}")


if __name__ == "__main__":
    main()
