"""Sessions in which a scripted operator teleoperates the simulated machine, recorded into genuine bags."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.formats.writer import write_bag
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.effects import PlantEffect
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import NANOSECONDS, SESSION_NAME, RecordConfig, record_session
from pipeline.plant.sealed.undeclared import parameters_of_session

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


def record_bag(
    session: Session,
    machine: MachineSpecification,
    effects: Sequence[PlantEffect],
    progress: Callable[[float], None],
) -> None:
    """Record one session of the simulated machine into a bag.

    Args:
        session: What is recorded.
        machine: Of which there must be a plant.
        effects: What is switched on in it.
        progress: Called with the time that has been simulated, s.
    """
    parameters, changes = parameters_of_session(simulated_machine(machine.name), effects, session.number)
    log = record_session(
        machine,
        parameters,
        draw_style(session.style_seed),
        session.minutes,
        session.seed,
        start_time_ns=int(session.start.timestamp()) * NANOSECONDS,
        changes=changes,
        progress=progress,
    )
    write_bag(
        session.path,
        machine,
        joint_state_header_stamp_ns=log.joint_state_header_stamp_ns,
        joint_state_log_time_ns=log.joint_state_log_time_ns,
        joint_names=log.joint_names,
        positions=log.positions,
        command_log_time_ns=log.command_log_time_ns,
        commands=log.commands,
    )
