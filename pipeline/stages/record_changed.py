"""Stage `record_changed`: the simulated machine again, days later, with an effect that nobody is told of."""

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.logs.formats.recorded_folders import clear_recorded, list_recorded
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.session import SESSION_NAME, RecordConfig
from pipeline.plant.sealed.seal import write_seal
from pipeline.plant.sealed.undeclared import draw_effects
from pipeline.stages.record import SEAL, operator_and_sessions, own_logs_among, record_bag
from pipeline.tracking import StageRun

SESSIONS = "sessions"


@dataclass
class RecordChangedConfig:
    """Section `record_changed` of a profile: what there is to know of the recording, but not what changed.

    Attributes:
        session_minutes: Duration of each session.
        days_later: Between the first session of `record` and the first of these; then one a day.
        seed: Of where the operator goes; the operator is that of `record`.
    """

    session_minutes: list[float]
    days_later: int
    seed: int

    def __post_init__(self) -> None:
        if not self.session_minutes or any(not minutes > 0.0 for minutes in self.session_minutes):
            raise InputError(
                f"record_changed.session_minutes is {self.session_minutes}; list positive durations in minutes"
            )
        for name in ("days_later", "seed"):
            if getattr(self, name) < 0:
                raise InputError(f"record_changed.{name} is {getattr(self, name)}; it must not be negative")


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
    output, machine, settings = (
        Path(configuration.output),
        configuration.machine,
        configuration.record_changed,
    )
    own = own_logs_among(
        {
            "logs": (configuration.logs, Path(configuration.recorded)),
            "measured": (configuration.measured, output / SESSIONS),
        }
    )
    effects = []
    if not own:
        effects = draw_effects(
            configuration.effects,
            configuration.effects_seed,
            simulated_machine(machine.name),
            configuration.effect_size,
            60.0 * settings.session_minutes[0],
        )
    clear_recorded(output, [SESSIONS], "record_changed", own)
    write_seal(output / SEAL, effects)
    if own:
        print(f"record_changed: the logs in {', '.join(own.values())} are your own; nothing is recorded")
        return
    style_seed, _ = operator_and_sessions(configuration.record.seed, 0)
    seeds = np.random.SeedSequence([configuration.record.seed, settings.seed]).generate_state(
        len(settings.session_minutes)
    )
    first = datetime.fromisoformat(configuration.record.first_session) + timedelta(days=settings.days_later)
    starts = [first + timedelta(days=number) for number in range(len(settings.session_minutes))]
    paths = [output / SESSIONS / start.strftime(SESSION_NAME) for start in starts]
    list_recorded(output, paths)
    sessions = zip(paths, settings.session_minutes, seeds.tolist(), starts, strict=True)
    for number, (path, minutes, seed, start) in enumerate(sessions):
        record_bag(path, machine, effects, number, style_seed, minutes, seed, start)
    run.metrics({"recorded_minutes": sum(settings.session_minutes)})


if __name__ == "__main__":
    main()
