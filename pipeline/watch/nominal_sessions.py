"""What nominal sessions teach: the model, and the statistics of sessions that it was not trained on.

One training serves all. Rows of nominal sessions are predicted by the members that did not learn from them, as if each
session were left out; later sessions by f. The rest is assumed: sessions of a sound machine are exchangeable.
"""

import dataclasses
import hashlib
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.diagnosis_model import (
    DiagnosisModel,
    train_diagnosis_model,
    training_of_diagnosis,
)
from pipeline.discrepancy.diagnosis.nominal.nominal_cache import Learned, identity, load_learned, save_learned
from pipeline.discrepancy.diagnosis.sampling_phase import sampling_phases
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.diagnosis.training_support import is_known
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.effects.catalogue import known_for
from pipeline.effects.effect import Setting
from pipeline.errors import InputError
from pipeline.files.record_file import load_record, save_record
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import CommandKind, MachineSpecification
from pipeline.watch import statistics
from pipeline.watch.log_identity import content_of
from pipeline.watch.statistics import Rows, Scale, session_statistics

MODEL, SESSIONS = "nominal_model.npz", "nominal_sessions.npz"
Session = Sequence[Trajectory]


class LearningSettings(NamedTuple):
    """The machine, and sections `close_loop` and `identify`."""

    machine: MachineSpecification
    close_loop: CloseLoopConfig
    identify: IdentifyConfig

    def key(self, of: Sequence[Trajectory] = ()) -> str:
        """Of what the model follows from: these, the code, and the logs."""
        return identity(of, self.machine, self.close_loop, self.identify)


@dataclasses.dataclass(frozen=True)
class NominalRows:
    """What is kept of the nominal sessions beside the model.

    Attributes:
        files: Key of the files that they were read from.
        settings: Key of the settings and the code.
        model: Key of the model.
        contents: What identifies each session.
        statistics: (n, n_joint, n_statistic).
        command: (B, T, n_joint) of all stretches, padded, as in `Sequences`; where the machine was seen to move.
        q: Likewise.
        velocity: Likewise.
        is_row: (B, T) bool.
    """

    files: str
    settings: str
    model: str
    contents: list[str]
    statistics: np.ndarray
    command: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    is_row: np.ndarray

    @property
    def seen(self) -> Sequences:
        """Without times, which nobody asks for."""
        none = np.zeros(0)
        return Sequences(self.command, self.q, self.velocity, none, none, self.is_row)


class NominalSessions:
    """The nominal machine, as far as its sessions show it: says of other sessions what they have of their own.

    Args:
        diagnosis: The model.
        rows: Of the nominal sessions.
        settings: As they were learned with.

    Attributes:
        scale: Of the machine's joints.
        least_s: Time for which a joint has to move in a session that says something of it.
    """

    def __init__(self, diagnosis: DiagnosisModel, rows: NominalRows, settings: LearningSettings) -> None:
        machine = settings.machine
        self.rows = rows
        speed = np.array(diagnosis.model.specification.residual_scale)
        self.scale = Scale(machine.lower, machine.upper, speed, machine.dt_s)
        self._diagnosis, self._machine = diagnosis, machine
        self.least_s = settings.close_loop.gate.smallest_excitation_s

    @property
    def key(self) -> str:
        """Of what statistics of sessions follow from."""
        code = Path(statistics.__file__).read_bytes() + Path(__file__).read_bytes()
        return hashlib.sha256(self.rows.model.encode() + code).hexdigest()

    def statistics_of(self, sessions: Sequence[Session], left_out: np.ndarray | None = None) -> np.ndarray:
        """(n, n_joint, n_statistic); NaN for a joint that hardly moves in a session.

        Args:
            sessions: Of the machine.
            left_out: (n_members, B, T) which member predicts which row of their stretches; None: f predicts all.
        """
        stretches = iter(self.stretches(list(itertools.chain(*sessions)), left_out))
        return np.stack(
            [
                session_statistics(list(itertools.islice(stretches, len(session))), self.scale, self.least_s)
                for session in sessions
            ]
        )

    def stretches(self, trajectories: Sequence[Trajectory], left_out: np.ndarray | None = None) -> list[Rows]:
        """What statistics are made of, per trajectory; `left_out` as of `statistics_of`."""
        machine = self._machine
        every = side_by_side(trajectories, machine.dt_s, self._diagnosis.model.specification.lags + 1)
        setting = Setting(machine.dt_s, machine.lower, machine.upper, self.scale.speed)
        some = list(known_for(machine.command_kind).values())[:1]  # of no effect there is no chain
        simulation = Simulation(self._diagnosis, every, some, setting, left_out)
        late = simulation.with_phases(sampling_phases(simulation, every.is_row))
        predicted = late.velocities([NOMINAL])[0]
        is_switched = machine.command_kind is CommandKind.discrete
        counts = is_known(self.rows.seen, every, setting, is_switched) & every.is_row[..., None]
        columns = every.command, every.q, every.velocity, predicted, every.time_s, counts
        return [Rows(*(column[index] for column in columns)) for index in range(len(trajectories))]


def load_nominal(
    folder: Path, settings: LearningSettings, files: str | None = None
) -> NominalSessions | None:
    """What was learned before by the same settings; None: nothing, or it is damaged.

    Args:
        folder: Of the state.
        settings: How to learn.
        files: Key of the files that it has to be learned from; None: of any.
    """
    try:
        rows = load_record(folder / SESSIONS, NominalRows)
    except InputError:
        return None
    is_same = rows.settings == settings.key() and files in (None, rows.files)
    learned = load_learned(folder / MODEL, rows.model) if is_same else None
    return None if learned is None else NominalSessions(learned.diagnosis, rows, settings)


def learn_nominal(
    folder: Path,
    files: str,
    sessions: Sequence[Session],
    settings: LearningSettings,
    log: Callable[[str], None],
) -> NominalSessions:
    """Train the model, unless it is there already, and judge each nominal session by what it did not learn from it.

    Args:
        folder: Of the state; what is learned is kept there.
        files: Key of the files that the sessions were read from.
        sessions: The nominal ones.
        settings: How to learn.
        log: Called with one sentence.

    Raises:
        InputError: The file of the model is damaged, or one cannot be written.
        UnusableLogs: The logs are too short.
    """
    trajectories = list(itertools.chain(*sessions))
    # `close_loop` keeps more under the plain key
    key = "watch " + settings.key(trajectories)
    learned = load_learned(folder / MODEL, key)
    machine = settings.machine
    lags = training_of_diagnosis(settings.identify).lags
    every = side_by_side(trajectories, machine.dt_s, lags + 1)
    if learned is None:
        log(f"training the model on {len(sessions)} nominal sessions")
        diagnosis = train_diagnosis_model(
            trajectories, every.q.shape[1], machine, settings.identify, settings.close_loop.seed
        )
        learned = Learned(diagnosis, {}, ())
        save_learned(folder / MODEL, learned, key)
    rows = NominalRows(
        files,
        settings.key(),
        key,
        [content_of(session) for session in sessions],
        np.zeros((0, 0, 0)),
        every.command.astype(np.float32),
        every.q.astype(np.float32),
        every.velocity.astype(np.float32),
        every.is_row,
    )
    nominal = NominalSessions(learned.diagnosis, rows, settings)
    found = nominal.statistics_of(sessions, learned.diagnosis.left_out)
    nominal.rows = dataclasses.replace(rows, statistics=found)
    save_record(folder / SESSIONS, nominal.rows)
    return nominal
