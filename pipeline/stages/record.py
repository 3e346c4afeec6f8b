"""Stage `record`: a scripted operator teleoperates the simulated machine; genuine bags are written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.logs.formats.recorded_folders import clear_recorded, list_recorded
from pipeline.logs.formats.writer import write_bag
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.effects import PlantEffect
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import NANOSECONDS, SESSION_NAME, RecordConfig, record_session
from pipeline.plant.sealed.seal import write_seal
from pipeline.plant.sealed.undeclared import draw_effects, parameters_of_session
from pipeline.tracking import StageRun, progress_bar

SEAL = "undeclared.seal"


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
    folders = {"sessions": record.session_minutes, "held_out": [record.held_out_minutes]}
    own_logs = own_logs_among({"logs": (configuration.logs, output / "sessions")})
    effects: list[PlantEffect] = []
    if not own_logs:
        effects = draw_effects(
            configuration.effects,
            configuration.effects_seed,
            simulated_machine(machine.name),
            configuration.effect_size,
            60.0 * record.session_minutes[0],
        )
    clear_recorded(output, folders, "record", own_logs)
    write_seal(output / SEAL, effects)
    if own_logs:
        print(
            f"record: the logs in {configuration.logs} take the place of recorded ones; nothing is recorded"
        )
        return
    sessions = [(folder, minutes) for folder, durations in folders.items() for minutes in durations]
    style_seed, seeds = operator_and_sessions(record.seed, len(sessions))
    first = datetime.fromisoformat(record.first_session)
    starts = [first + timedelta(days=number) for number in range(len(sessions))]
    paths = [
        output / folder / start.strftime(SESSION_NAME)
        for (folder, _), start in zip(sessions, starts, strict=True)
    ]
    list_recorded(output, paths)
    for number, (path, (_, minutes), seed, start) in enumerate(
        zip(paths, sessions, seeds, starts, strict=True)
    ):
        record_bag(path, machine, effects, number, style_seed, minutes, seed, start)
    run.metrics({"recorded_minutes": sum(minutes for _, minutes in sessions)})


def own_logs_among(settings: Mapping[str, tuple[str | None, Path]]) -> dict[str, str]:
    """Of settings with the folder that each gives and the recorded one, those that name a user's own logs.

    Raises:
        InputError: They are not there; nothing is recorded for them.
    """
    own = {}
    for name, (given, recorded) in settings.items():
        if given is None or Path(given).resolve() == recorded.resolve():
            continue
        if not Path(given).exists():
            raise InputError(
                f"{name}={given}: no such folder; name a folder of own logs, or none to have some recorded"
            )
        own[name] = given
    return own


def operator_and_sessions(seed: int, n_sessions: int) -> tuple[int, list[int]]:
    """Seeds of the operator's style and of each session; the style's is the same for any number of sessions."""
    style_seed, *seeds = np.random.SeedSequence(seed).generate_state(1 + n_sessions).tolist()
    return style_seed, seeds


def record_bag(
    path: Path,
    machine: MachineSpecification,
    effects: Sequence[PlantEffect],
    number: int,
    style_seed: int,
    minutes: float,
    seed: int,
    start: datetime,
) -> None:
    """Record one session of the simulated machine into a bag."""
    parameters, changes = parameters_of_session(simulated_machine(machine.name), effects, number)
    with progress_bar(f"record {path.name}", total=round(minutes * 60), unit="s") as bar:
        log = record_session(
            machine,
            parameters,
            draw_style(style_seed),
            minutes,
            seed,
            start_time_ns=int(start.timestamp()) * NANOSECONDS,
            changes=changes,
            progress=lambda time_s: bar.update(round(time_s) - bar.n),
        )
    write_bag(
        path,
        machine,
        joint_state_header_stamp_ns=log.joint_state_header_stamp_ns,
        joint_state_log_time_ns=log.joint_state_log_time_ns,
        joint_names=log.joint_names,
        positions=log.positions,
        command_log_time_ns=log.command_log_time_ns,
        commands=log.commands,
    )


if __name__ == "__main__":
    main()
