"""Stage `record`: a scripted operator teleoperates the simulated machine; genuine bags are written."""

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
    HELD_OUT,
    SEAL,
    SESSIONS,
    nominal_sessions,
    own_logs_among,
    record_bag,
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
    output: OutputFolder = MISSING


@stage(RecordStage)
def main(configuration: RecordStage, run: StageRun) -> None:
    """Record the sessions to learn from and the held-out one, unless the user named logs of their own."""
    output, record, machine = Path(configuration.output), configuration.record, configuration.machine
    own_logs = own_logs_among({"logs": (configuration.logs, output / SESSIONS)})
    effects = (
        []
        if own_logs
        else draw_effects(
            configuration.effects,
            configuration.effects_seed,
            simulated_machine(machine.name),
            configuration.effect_size,
            60.0 * record.session_minutes[0],
        )
    )
    clear_recorded(output, (SESSIONS, HELD_OUT), "record", own_logs)
    write_seal(output / SEAL, effects)
    if own_logs:
        print(
            f"record: the logs in {configuration.logs} take the place of recorded ones; nothing is recorded"
        )
        return
    sessions = nominal_sessions(output, record)
    list_recorded(output, [session.path for session in sessions])
    for session in sessions:
        with progress_bar(f"record {session.path.name}", round(60 * session.minutes), "s") as bar:
            record_bag(session, machine, effects, bar.reach)
    run.metrics({"recorded_minutes": sum(session.minutes for session in sessions)})


if __name__ == "__main__":
    main()
