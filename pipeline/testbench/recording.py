"""Sessions in which a scripted operator teleoperates the simulated machine, recorded into genuine bags."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.recorded_folders import clear_recorded, list_recorded
from pipeline.logs.formats.writer import write_bag
from pipeline.logs.messages.raw_log import ChannelSamples
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.effects import PlantEffect
from pipeline.plant.machines.field import draw_shift
from pipeline.plant.machines.simulated import Condition, simulated_machine
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import (
    NANOSECONDS,
    SESSION_NAME,
    RecordConfig,
    SessionLog,
    record_session,
)
from pipeline.plant.sealed.seal import write_seal
from pipeline.plant.sealed.undeclared import draw_effects, parameters_of_session

SESSIONS, HELD_OUT, SEAL = "sessions", "held_out", "undeclared.seal"


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


class EffectDraw(NamedTuple):
    """Which effects are drawn, for a machine in which condition; see `draw_effects`.

    Attributes:
        kinds: Their names.
        size: Strength, 1 for plain effects.
        first_session_minutes: Within which a change point lies.
    """

    kinds: Sequence[str]
    seed: int
    size: float
    first_session_minutes: float
    condition: Condition


class Progress(Protocol):
    """A progress bar."""

    def reach(self, done: float) -> None:
        """So much is done."""


class Session(NamedTuple):
    """A session to be recorded.

    Attributes:
        number: Its place among all, which effects that set in later go by.
        path: Of the bag.
        style_seed: Of the operator's habits.
        seed: Of where the operator goes.
    """

    number: int
    path: Path
    minutes: float
    style_seed: int
    seed: int
    start: datetime


def nominal_sessions(output: Path, record: RecordConfig) -> list[Session]:
    """The sessions to learn from, and the held-out one."""
    folders = {SESSIONS: record.session_minutes, HELD_OUT: [record.held_out_minutes]}
    durations = [(output / folder, minutes) for folder in folders for minutes in folders[folder]]
    style_seed, seeds = operator_and_sessions(record.seed, len(durations))
    return _daily(durations, datetime.fromisoformat(record.first_session), style_seed, seeds)


def changed_sessions(output: Path, record: RecordConfig, changed: RecordChangedConfig) -> list[Session]:
    """Sessions of the same operator, days later."""
    durations = [(output / SESSIONS, minutes) for minutes in changed.session_minutes]
    style_seed, _ = operator_and_sessions(record.seed, 0)
    seeds = np.random.SeedSequence([record.seed, changed.seed]).generate_state(len(durations)).tolist()
    first = datetime.fromisoformat(record.first_session) + timedelta(days=changed.days_later)
    return _daily(durations, first, style_seed, seeds)


def _daily(
    durations: Sequence[tuple[Path, float]], first: datetime, style_seed: int, seeds: Sequence[int]
) -> list[Session]:
    starts = [first + timedelta(days=number) for number in range(len(durations))]
    return [
        Session(number, folder / start.strftime(SESSION_NAME), minutes, style_seed, seed, start)
        for number, ((folder, minutes), seed, start) in enumerate(zip(durations, seeds, starts, strict=True))
    ]


def operator_and_sessions(seed: int, n_sessions: int) -> tuple[int, list[int]]:
    """Seeds of the operator's style and of each session; the style's is the same for any number of sessions."""
    style_seed, *seeds = np.random.SeedSequence(seed).generate_state(1 + n_sessions).tolist()
    return style_seed, seeds


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


def begin_recording(
    output: Path,
    folders: Iterable[str],
    stage: str,
    own_logs: Mapping[str, str],
    machine: MachineSpecification,
    draw: EffectDraw,
) -> list[PlantEffect]:
    """Delete what the stage recorded before, and seal the effects of the new recording: none beside own logs.

    Args:
        output: Parent of the folders and of the seal.
        folders: Names of the folders that the stage records into.
        stage: Its name, for messages.
        own_logs: The user's logs that replace recordings, by the settings' names.
        machine: Of which there must be a plant, unless own logs replace recordings.
        draw: Which effects are drawn.

    Raises:
        InputError: No such effects can be drawn, or a folder holds something else.
    """
    effects: list[PlantEffect] = []
    if not own_logs:  # a machine that is measured needs no plant
        nominal = simulated_machine(machine.name, draw.condition)
        first_session_s = 60.0 * draw.first_session_minutes
        effects = draw_effects(draw.kinds, draw.seed, nominal, draw.size, first_session_s)
    clear_recorded(output, folders, stage, own_logs)
    write_seal(output / SEAL, effects)
    return effects


def record_sessions(
    output: Path,
    sessions: Sequence[Session],
    machine: MachineSpecification,
    effects: Sequence[PlantEffect],
    condition: Condition,
    progress_bar: Callable[[str, int, str], AbstractContextManager[Progress]],
) -> float:
    """Record sessions into bags below `output`, and return their minutes.

    Args:
        output: Parent of their folders, and of the list of what is recorded.
        sessions: What is recorded.
        machine: Of which there must be a plant.
        effects: What is switched on in it.
        condition: Of the plant.
        progress_bar: Opened per session with its description, its duration, and the duration's unit.
    """
    list_recorded(output, [session.path for session in sessions])
    for session in sessions:
        with progress_bar(f"record {session.path.name}", round(60 * session.minutes), "s") as bar:
            _record_bag(session, machine, effects, condition, bar.reach)
    return sum(session.minutes for session in sessions)


def _record_bag(
    session: Session,
    machine: MachineSpecification,
    effects: Sequence[PlantEffect],
    condition: Condition,
    progress: Callable[[float], None],
) -> None:
    nominal = simulated_machine(machine.name, condition)
    parameters, changes = parameters_of_session(nominal, effects, session.number)
    is_field = condition is Condition.field
    log = record_session(
        machine,
        parameters,
        draw_style(session.style_seed),
        session.minutes,
        session.seed,
        start_time_ns=int(session.start.timestamp()) * NANOSECONDS,
        changes=changes,
        progress=progress,
        shift=draw_shift(session.seed, 60.0 * session.minutes) if is_field else None,
    )
    channels = {name: ChannelSamples(*samples) for name, samples in log.channels.items()}
    write_session(session.path, machine, log, channels)


def write_session(
    path: Path,
    machine: MachineSpecification,
    log: SessionLog,
    channels: Mapping[str, ChannelSamples] | None = None,
) -> None:
    """Write a simulated session as a bag; `channels` are those of the machine's file."""
    write_bag(
        path,
        machine,
        joint_state_header_stamp_ns=log.joint_state_header_stamp_ns,
        joint_state_log_time_ns=log.joint_state_log_time_ns,
        joint_names=log.joint_names,
        positions=log.positions,
        command_log_time_ns=log.command_log_time_ns,
        commands=log.commands,
        channels=channels,
    )
