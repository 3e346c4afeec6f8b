"""A worker's lease on an attempt: a heartbeat until the attempt ends or another worker takes it over."""

import threading
import time
from typing import Any

import optuna
from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import TrialState as AttemptState
from sqlalchemy.exc import SQLAlchemyError

from pipeline.study.trials import SECONDS


class LostError(Exception):
    """Another worker has taken this trial over."""


class Lease:
    """Lease of this process on a running attempt, from `start` to `end`."""

    def __init__(self, attempt: optuna.Trial, heartbeat_s: float) -> None:
        self._attempt = attempt
        self._heartbeat_s = heartbeat_s
        self._start_s = time.monotonic()
        self._lost = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat, daemon=True)

    @property
    def spent_s(self) -> float:
        """Time since the attempt was claimed."""
        return time.monotonic() - self._start_s

    def start(self) -> None:
        """Send the first heartbeat and keep sending."""
        self._attempt.set_user_attr(SECONDS, 0.0)
        self._thread.start()

    def check(self) -> None:
        """Raise `LostError` if others have taken the trial over."""
        if self._lost.is_set():
            raise LostError

    def end(self, state: AttemptState, value: float | None, attributes: dict[str, Any]) -> None:
        """Record the attempt's end.

        Raises:
            LostError: if others have taken the trial over; then nothing is recorded.
        """
        self.stop()
        try:
            for key, content in (attributes | {SECONDS: self.spent_s}).items():
                self._attempt.set_user_attr(key, content)
            self._attempt.study.tell(self._attempt, value, state)
        except (UpdateFinishedTrialError, ValueError) as error:  # ValueError: it was FAIL when Optuna looked
            raise LostError from error

    def stop(self) -> None:
        """End the heartbeat and record nothing."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _beat(self) -> None:
        while not self._ended.wait(self._heartbeat_s):
            try:
                self._attempt.set_user_attr(SECONDS, self.spent_s)
            except (UpdateFinishedTrialError, KeyError):
                self._lost.set()
                return
            except (optuna.exceptions.OptunaError, SQLAlchemyError, OSError):
                continue  # the storage may be back before the lease expires
