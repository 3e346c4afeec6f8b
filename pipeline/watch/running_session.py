"""The session in progress, judged as `look` will judge its log; the state is only read."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.messages.raw_log import RawLog
from pipeline.logs.trajectories import make_trajectories
from pipeline.watch.document import document_of
from pipeline.watch.judgement import Judgement, judge, record_of
from pipeline.watch.nominal_sessions import load_nominal
from pipeline.watch.session_store import SessionStore
from pipeline.watch.statistics import moved_s, session_statistics
from pipeline.watch.watch_inputs import WatchSettings


class Standing(NamedTuple):
    """Where a machine stands.

    Attributes:
        document: As of `document_of`, of the state's sessions and the running one.
        own: The document's entry of the running session; None: it has not been judged, or does not count.
        moved_s: (n_joint,) for how long each joint has moved in the running session [s].
        left_out: How many sessions of the state do not count.
    """

    document: dict[str, Any]
    own: dict[str, Any] | None
    moved_s: np.ndarray
    left_out: int


class RunningSession:
    """Judges a session while it grows.

    Args:
        state: Folder that `look` keeps.
        settings: As `look` has them.

    Attributes:
        least_s: Time for which a joint has to move.

    Raises:
        InputError: The state is damaged, or of another machine, other settings or another version.
    """

    def __init__(self, state: Path, settings: WatchSettings) -> None:
        nominal = load_nominal(state, settings.learning)
        if nominal is None:
            raise InputError(
                f"{state}: holds nothing that `watch` learned of this machine by this profile and version; "
                "run `watch` with this state first"
            )
        self._state, self._nominal, self._settings = state, nominal, settings
        self.least_s = nominal.least_s

    def before(self) -> Standing:
        """Without the running session.

        Raises:
            InputError: The state is damaged.
        """
        found = judge(SessionStore(self._state), self._nominal, self._settings.watch)
        return Standing(
            self._document(found), None, np.zeros(self._settings.machine.n_joint), len(found.left_out)
        )

    def judged(self, raw: RawLog) -> Standing:
        """With it.

        Args:
            raw: Its messages so far.

        Raises:
            InputError: The messages yield no trajectory, or the state is damaged.
        """
        settings, nominal = self._settings, self._nominal
        log = make_trajectories(raw, settings.machine, settings.ingest, settings.loop_tracker)
        stretches = nominal.stretches(log.trajectories)
        values = session_statistics(stretches, nominal.scale, nominal.least_s)
        running = record_of(log.trajectories, values, nominal.key, raw.name)
        found = judge(SessionStore(self._state), nominal, settings.watch, running)
        document, own = self._document(found), None
        if running in found.records:
            own = document["sessions"][found.records.index(running)]
        return Standing(document, own, moved_s(stretches, nominal.scale), len(found.left_out))

    def _document(self, found: Judgement) -> dict[str, Any]:
        machine, alarm_at = self._settings.machine, 1.0 / self._settings.watch.false_alarms
        return document_of(machine.name, list(machine.joint_names), found.records, found.course, alarm_at)
