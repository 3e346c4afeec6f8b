"""Stage `record_changed`: the simulated machine again, days later, with an effect that nobody is told of."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.plant.machines.simulated import Condition
from pipeline.plant.recording.session import RecordConfig
from pipeline.testbench.recording import (
    SESSIONS,
    EffectDraw,
    RecordChangedConfig,
    begin_recording,
    changed_sessions,
    own_logs_among,
    record_sessions,
)
from pipeline.tracking import StageRun, progress_bar


@dataclass
class RecordChangedStage(PipelineConfiguration):
    """Keys of `conf/record_changed.yaml`."""

    record: RecordConfig = MISSING
    record_changed: RecordChangedConfig = MISSING
    logs: str | None = None  # no inputs where they name what is recorded
    measured: str | None = None
    recorded: str = MISSING
    effects: list[str] = field(default_factory=list)
    effects_seed: int = MISSING
    effect_size: float = MISSING
    condition: Condition = MISSING
    output: OutputFolder = MISSING


@stage(RecordChangedStage)
def main(configuration: RecordChangedStage, run: StageRun) -> None:
    """Record the changed machine and seal what changed, unless the user named logs of their own."""
    output, machine, changed = Path(configuration.output), configuration.machine, configuration.record_changed
    recorded, here = Path(configuration.recorded), output / SESSIONS
    own = own_logs_among({"logs": (configuration.logs, recorded), "measured": (configuration.measured, here)})
    kinds, seed, size = configuration.effects, configuration.effects_seed, configuration.effect_size
    draw = EffectDraw(kinds, seed, size, changed.session_minutes[0], configuration.condition)
    effects = begin_recording(output, [SESSIONS], "record_changed", own, machine, draw)
    if own:
        print(f"record_changed: the logs in {', '.join(own.values())} are your own; nothing is recorded")
        return
    sessions = changed_sessions(output, configuration.record, changed)
    minutes = record_sessions(output, sessions, machine, effects, configuration.condition, progress_bar)
    run.metrics({"recorded_minutes": minutes})


if __name__ == "__main__":
    main()
