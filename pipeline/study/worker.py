"""A worker: runs trials of a study until all are finished, beside other workers that may die.

Workers know of each other only through the storage. These rules keep the number of trials exact:

- Optuna numbers attempts uniquely, and a trial's number follows from that (`trials.group_attempts`). A worker
  whose trial lies beyond the study's last gives it back.
- An attempt whose worker has died is failed, and a retry with the same hyper-parameters is queued. Several workers
  may queue one at once; the earliest attempt that has not failed owns the trial, the others are given back.
- A live worker that passed for dead cannot record its result, as its attempt has failed.
"""

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import optuna
from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import FrozenTrial
from optuna.trial import TrialState as AttemptState
from sqlalchemy.exc import SQLAlchemyError

from pipeline.dynamics.search.search_space import Choose, Value
from pipeline.errors import InputError
from pipeline.study import storage as storages
from pipeline.study.lease import Lease, LostError
from pipeline.study.liveness import is_known_dead, own_identity
from pipeline.study.sampler import SeededPerTrial, build_pruner
from pipeline.study.settings import Pruner, StudySettings
from pipeline.study.trials import (
    DIVERGED,
    FACTS,
    FINISHED,
    REASON,
    RETRY_OF,
    SECONDS,
    SURPLUS,
    WORKER,
    Trial,
    TrialOutcome,
    group_attempts,
    read_trial,
    trial_number,
)

LONGEST_WAIT_S = 1.0  # between two polls of the other workers' progress

Proposal = TypeVar("Proposal")


class DivergedError(Exception):
    """The objective has no finite value here; the sampler avoids this region."""


class RunningTrial:
    """The objective's view of the trial that it evaluates."""

    def __init__(self, attempt: optuna.Trial, number: int, lease: Lease, reported: set[int] | None) -> None:
        self.number = number
        self._attempt = attempt
        self._lease = lease
        self._reported = reported  # epochs that an earlier attempt reported; None: no pruning

    def report(self, epoch: int, value: float) -> None:
        """Report the value after an epoch; an exception ends the trial and must not be caught."""
        self._lease.check()
        if self._reported is None:
            return
        if epoch not in self._reported:
            self._attempt.report(value, epoch)
        if self._attempt.should_prune():
            raise optuna.TrialPruned(f"pruned after epoch {epoch}")


Evaluate = Callable[[Proposal, RunningTrial], tuple[float, dict[str, Any]]]


class Study(Generic[Proposal]):
    """A study, from one worker's side."""

    def __init__(self, storage: str, name: str, settings: StudySettings, maximum_epochs: int) -> None:
        """Open a study, or create it.

        Args:
            storage: See `storage.open_storage`.
            name: Name of the study; workers that give the same name share it.
            settings: How trials are proposed, ended and handed on.
            maximum_epochs: Most epochs of any trial.

        Raises:
            InputError: if the storage cannot be opened.
        """
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.name = name
        self.identity = own_identity()
        self._settings = settings
        self._storage_address = storages.without_password(storage)
        sampler = SeededPerTrial(settings)
        self._study = optuna.create_study(
            study_name=name,
            storage=storages.open_storage(storage),
            sampler=sampler,
            pruner=build_pruner(settings, maximum_epochs),
            direction="minimize",
            load_if_exists=True,
        )
        sampler.full_study = self._study
        self._heard: dict[int, tuple[object, float]] = {}

    def trials(self) -> list[Trial]:
        """All trials in the order of their numbers, unfinished ones included."""
        grouped = group_attempts(self._study.get_trials(deepcopy=False))
        return [
            read_trial(number, attempts, self._settings.maximum_attempts)
            for number, attempts in sorted(grouped.items())
            if any(attempt.user_attrs.get(REASON) != SURPLUS for attempt in attempts)
        ]

    def finished_by(self) -> str | None:
        """Identity of the worker that finished the last of the finished trials."""
        ended = [attempt for attempt in self._attempts() if attempt.state in FINISHED]
        if not ended:
            return None
        last = max(ended, key=lambda attempt: (attempt.datetime_complete, attempt.number))
        return last.user_attrs.get(WORKER)

    def run(
        self,
        n_trials: int,
        propose: Callable[[Choose], Proposal],
        evaluate: Evaluate[Proposal],
        finished: Callable[[Trial], None] = lambda trial: None,
    ) -> None:
        """Work until `n_trials` trials of the study are finished, by this worker or others.

        A trial whose hyper-parameters equal those of a complete one takes its value: training is deterministic.

        Args:
            n_trials: Number of trials in the study.
            propose: Chooses hyper-parameters.
            evaluate: (proposal, trial) -> value to be minimised, facts for the record. May raise `DivergedError`.
            finished: Called with each trial that this worker finished.

        Raises:
            InputError: from `evaluate`, or if the storage fails; the next start then resumes the trial.
        """
        try:
            while (attempt := self._next_attempt(n_trials)) is not None:
                number = trial_number(self._attempts(), attempt.number)
                with contextlib.suppress(LostError):
                    self._run_attempt(attempt, number, propose, evaluate)
                    finished(next(trial for trial in self.trials() if trial.number == number))
        except (optuna.exceptions.StorageInternalError, SQLAlchemyError) as error:
            cause = error.__cause__ or error
            raise InputError(
                f"storage={self._storage_address}: {getattr(cause, 'orig', None) or cause}; nothing finished is lost: "
                "start it again when the storage is back"
            ) from error

    def _attempts(self) -> list[FrozenTrial]:
        return self._study.get_trials(deepcopy=False)

    def _next_attempt(self, n_trials: int) -> optuna.Trial | None:
        """Claim an attempt; None when all trials are finished. Waits while others run the last ones."""
        while True:
            self._fail_stale()
            grouped = group_attempts(self._attempts())
            unfinished = {
                number: grouped.get(number, [])
                for number in range(n_trials)
                if number not in grouped
                or read_trial(number, grouped[number], self._settings.maximum_attempts).outcome
                is TrialOutcome.open
            }
            if not unfinished:
                return None
            for number, attempts in unfinished.items():
                if attempts and _all_failed(attempts):
                    self._queue_retry(number, attempts)
            if any(_is_free(attempts) for attempts in unfinished.values()):
                attempt = self._study.ask()
                if self._owns(attempt, n_trials):
                    return attempt
            else:
                time.sleep(min(LONGEST_WAIT_S, self._settings.heartbeat_s))

    def _queue_retry(self, number: int, attempts: Sequence[FrozenTrial]) -> None:
        source = next((attempt for attempt in reversed(attempts) if SECONDS in attempt.user_attrs), None)
        self._study.add_trial(
            optuna.create_trial(
                state=AttemptState.WAITING,
                params=source.params if source else None,
                distributions=source.distributions if source else None,
                intermediate_values=source.intermediate_values if source else None,
                user_attrs={RETRY_OF: number},
            )
        )

    def _owns(self, claimed: optuna.Trial, n_trials: int) -> bool:
        """Whether the claimed attempt owns its trial; if not, it is given back."""
        all_attempts = self._attempts()
        number = trial_number(all_attempts, claimed.number)
        attempts = group_attempts(all_attempts)[number]
        reason = None
        if number >= n_trials and len(attempts) == 1:
            reason = SURPLUS
        elif any(
            attempt.number < claimed.number and attempt.state is not AttemptState.FAIL for attempt in attempts
        ):
            reason = "another attempt came first"
        if reason is None:
            return True
        claimed.set_user_attr(REASON, reason)
        self._study.tell(claimed, state=AttemptState.FAIL)
        return False

    def _run_attempt(
        self,
        attempt: optuna.Trial,
        number: int,
        propose: Callable[[Choose], Proposal],
        evaluate: Evaluate[Proposal],
    ) -> None:
        """Run an attempt and record its end."""

        def choose(name: str, options: Sequence[Value]) -> Value:
            return attempt.suggest_categorical(name, options)

        lease = Lease(attempt, self._settings.heartbeat_s)
        try:
            attempt.set_user_attr(WORKER, self.identity)
            proposal = propose(choose)
            lease.start()
            twin = self._twin(number, attempt.params)
            if twin is not None:
                lease.end(AttemptState.COMPLETE, twin.value, {FACTS: twin.facts | {"same_as": twin.number}})
                return
            reported = None
            if self._settings.pruner is not Pruner.none:
                reported = set(self._attempts()[attempt.number].intermediate_values)
            value, facts = evaluate(proposal, RunningTrial(attempt, number, lease, reported))
            if not math.isfinite(value):
                raise DivergedError(f"the value is {value}")
            lease.end(AttemptState.COMPLETE, value, {FACTS: facts})
        except optuna.TrialPruned as pruned:
            lease.end(AttemptState.PRUNED, None, {REASON: str(pruned)})
        except DivergedError as diverged:
            lease.end(AttemptState.PRUNED, None, {REASON: f"{DIVERGED}: {diverged}"})
        except InputError as refused:
            lease.end(AttemptState.FAIL, None, {REASON: f"refused: {refused}"})
            raise
        except KeyboardInterrupt:
            lease.end(AttemptState.FAIL, None, {REASON: "interrupted"})
            raise
        finally:
            lease.stop()

    def _twin(self, number: int, parameters: dict[str, Any]) -> Trial | None:
        """A complete trial with the same hyper-parameters whose value was computed, not copied."""
        return next(
            (
                trial
                for trial in self.trials()
                if trial.number != number
                and trial.outcome is TrialOutcome.complete
                and trial.parameters == parameters
                and "same_as" not in trial.facts
            ),
            None,
        )

    def _fail_stale(self) -> None:
        """Fail the attempts of dead workers, and those of this worker, which runs nothing at this point."""
        now_s = time.monotonic()
        for attempt in self._attempts():
            if attempt.state is not AttemptState.RUNNING:
                continue
            worker = attempt.user_attrs.get(WORKER)
            sign = (worker, attempt.user_attrs.get(SECONDS))
            heard, since_s = self._heard.get(attempt.number, (None, now_s))
            if heard != sign:
                self._heard[attempt.number] = (sign, now_s)
                since_s = now_s
            silent = now_s - since_s > self._settings.stale_after_s
            if silent or (worker is not None and (worker == self.identity or is_known_dead(worker))):
                with contextlib.suppress(
                    UpdateFinishedTrialError
                ):  # another worker finished or failed it first
                    self._study.tell(attempt.number, state=AttemptState.FAIL, skip_if_finished=True)


def _all_failed(attempts: Sequence[FrozenTrial]) -> bool:
    return all(attempt.state is AttemptState.FAIL for attempt in attempts)


def _is_free(attempts: Sequence[FrozenTrial]) -> bool:
    """Whether nobody runs the trial of these attempts: no attempt was started, all failed, or one waits."""
    return _all_failed(attempts) or any(attempt.state is AttemptState.WAITING for attempt in attempts)
