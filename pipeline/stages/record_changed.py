"""Stage `record_changed`: the simulated machine again, days later, with an effect that nobody is told of."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.logs.formats.recorded_folders import clear_recorded, list_recorded
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.session import RecordConfig
from pipeline.plant.sealed.seal import write_seal
from pipeline.plant.sealed.undeclared import draw_effects
from pipeline.testbench.recording import (
    SEAL,
    SESSIONS,
    RecordChangedConfig,
    changed_sessions,
    own_logs_among,
    record_bag,
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
    output: OutputFolder = MISSING


@stage(RecordChangedStage)
def main(configuration: RecordChangedStage, run: StageRun) -> None:
    """Record the changed machine and seal what changed, unless the user named logs of their own."""
    output, machine, changed = Path(configuration.output), configuration.machine, configuration.record_changed
    own = own_logs_among(
        {
            "logs": (configuration.logs, Path(configuration.recorded)),
            "measured": (configuration.measured, output / SESSIONS),
        }
    )
    effects = (
        []
        if own
        else draw_effects(
            configuration.effects,
            configuration.effects_seed,
            simulated_machine(machine.name),
            configuration.effect_size,
            60.0 * changed.session_minutes[0],
        )
    )
    clear_recorded(output, [SESSIONS], "record_changed", own)
    write_seal(output / SEAL, effects)
    if own:
        print(f"record_changed: the logs in {', '.join(own.values())} are your own; nothing is recorded")
        return
    sessions = changed_sessions(output, configuration.record, changed)
    list_recorded(output, [session.path for session in sessions])
    for session in sessions:
        with progress_bar(f"record {session.path.name}", round(60 * session.minutes), "s") as bar:
            record_bag(session, machine, effects, bar.reach)
    run.metrics({"recorded_minutes": sum(session.minutes for session in sessions)})


if __name__ == "__main__":
    main()
