"""What a look is given, and how it reads a session."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.trajectories import LogTrajectories, make_trajectories
from pipeline.machine.specification import MachineSpecification
from pipeline.watch.nominal_sessions import LearningSettings
from pipeline.watch.settings import WatchConfig


@dataclass(frozen=True)
class WatchInputs:
    """Paths.

    Attributes:
        nominal: Folder of logs of the machine as it should be; each log is a session.
        sessions: Folder of logs that grows.
        state: Folder that keeps what is known from one look to the next.
        output: Folder for what is found.
        model: Folder of a model to correct when a change is found; None: the one that finds it.
        baseline_ns: Stamp from which on sessions are a new baseline; None: no maintenance is told.
    """

    nominal: Path
    sessions: Path
    state: Path
    output: Path
    model: Path | None = None
    baseline_ns: int | None = None

    @classmethod
    def told(
        cls, nominal: str, sessions: str, state: str, output: str, model: str | None, baseline: str | None
    ) -> "WatchInputs":
        """As a user writes them; `baseline` as of `stamp_of`.

        Raises:
            InputError: It is no time.
        """
        stamp_ns = None if baseline is None else stamp_of(baseline)
        given = None if model is None else Path(model)
        return cls(Path(nominal), Path(sessions), Path(state), Path(output), given, stamp_ns)


@dataclass(frozen=True)
class WatchSettings:
    """The machine, sections `ingest`, `control.loop_tracker`, `identify`, `close_loop` and `watch`."""

    machine: MachineSpecification
    ingest: IngestConfig
    loop_tracker: LoopTrackerConfig
    identify: IdentifyConfig
    close_loop: CloseLoopConfig
    watch: WatchConfig

    @property
    def learning(self) -> LearningSettings:
        """What the nominal machine is learned with."""
        return LearningSettings(self.machine, self.close_loop, self.identify)


def read_session(entry: LogEntry, settings: WatchSettings) -> LogTrajectories:
    """Read one log.

    Raises:
        InputError: It cannot be used.
    """
    machine, ingest = settings.machine, settings.ingest
    raw = read_log(entry, machine, None, ingest.maximum_gap_s)
    return make_trajectories(raw, machine, ingest, settings.loop_tracker)


def stamp_of(baseline: str) -> int:
    """The moment [ns since 1970] that maintenance was done: `now`, or a time as of ISO 8601, else in UTC.

    Raises:
        InputError: It is neither.
    """
    try:
        at = datetime.now(UTC) if baseline == "now" else datetime.fromisoformat(baseline)
    except ValueError as error:
        raise InputError(f"baseline={baseline}: not a time; write now, or 2025-03-03T08:00+01:00") from error
    return round((at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()) * 10**9
