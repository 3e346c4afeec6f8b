"""Stage `record`: a scripted operator teleoperates the simulated machine; genuine bags are written."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.plant.machines.simulated import Condition
from pipeline.plant.recording.session import RecordConfig
from pipeline.testbench.recording import (
    HELD_OUT,
    SESSIONS,
    EffectDraw,
    begin_recording,
    nominal_sessions,
    own_logs_among,
    record_sessions,
)
from pipeline.tracking import StageRun, progress_bar


@dataclass
class RecordStage(PipelineConfiguration):
    """Keys of `conf/record.yaml`."""

    record: RecordConfig = MISSING
    logs: str | None = None  # no input where it names what is recorded here
    effects: list[str] = field(default_factory=list)
    effects_seed: int = MISSING
    effect_size: float = MISSING
    condition: Condition = MISSING
    output: OutputFolder = MISSING


@stage(RecordStage)
def main(configuration: RecordStage, run: StageRun) -> None:
    """Record the sessions to learn from and the held-out one, unless the user named logs of their own."""
    output, record, machine = Path(configuration.output), configuration.record, configuration.machine
    own_logs = own_logs_among({"logs": (configuration.logs, output / SESSIONS)})
    kinds, seed, size = configuration.effects, configuration.effects_seed, configuration.effect_size
    draw = EffectDraw(kinds, seed, size, record.session_minutes[0], configuration.condition)
    effects = begin_recording(output, (SESSIONS, HELD_OUT), "record", own_logs, machine, draw)
    if own_logs:
        print(
            f"record: the logs in {configuration.logs} take the place of recorded ones; nothing is recorded"
        )
        return
    sessions = nominal_sessions(output, record)
    minutes = record_sessions(output, sessions, machine, effects, configuration.condition, progress_bar)
    run.metrics({"recorded_minutes": minutes})


if __name__ == "__main__":
    main()
