"""Trials and their attempts.

A trial is one set of hyper-parameters, numbered 0 … n-1 within its study. Optuna's own trials are attempts at it: the
first, and one more each time that its worker died or was interrupted. Such an attempt has Optuna's state
FAIL; the trial is finished as soon as one attempt is COMPLETE or PRUNED.
"""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from optuna.trial import FrozenTrial
from optuna.trial import TrialState as AttemptState

# Attributes of an attempt.
RETRY_OF = "retry_of"  # number of the trial, on every attempt but the first
WORKER = "worker"  # identity of the process that runs it
SECONDS = "seconds"  # spent so far; repeated writing is the worker's heartbeat
FACTS = "facts"  # what the objective reported beside the value
REASON = "reason"  # why it ended without a value
DIVERGED = "diverged"
SURPLUS = "surplus"  # two workers claimed the study's last trial; this one was too late

FINISHED = (AttemptState.COMPLETE, AttemptState.PRUNED)


class TrialOutcome(enum.StrEnum):
    """State of a trial."""

    complete = "complete"
    pruned = "pruned"
    diverged = "diverged"
    given_up = "given_up"  # too many workers died over it
    open = "open"  # not finished


@dataclass(frozen=True)
class Trial:
    """A trial, summed up from all its attempts.

    Attributes:
        number: 0 … n-1.
        outcome: How it ended.
        parameters: Hyper-parameters by name.
        value: Value of the objective; None unless complete.
        facts: Further results that the objective reported.
        seconds: Time spent on all attempts.
        attempts: Number of attempts that did work on it.
        worker: Identity of the worker that finished it.
        reason: Why `value` is missing.
    """

    number: int
    outcome: TrialOutcome
    parameters: dict[str, Any] = field(default_factory=dict)
    value: float | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    attempts: int = 0
    worker: str = ""
    reason: str = ""


def group_attempts(attempts: Iterable[FrozenTrial]) -> dict[int, list[FrozenTrial]]:
    """Attempts by the number of their trial, each in the order of their creation.

    A first attempt's trial is its rank among the first attempts. The number never changes and needs no shared counter.
    """
    trials: dict[int, list[FrozenTrial]] = {}
    n_retries = 0
    for attempt in sorted(attempts, key=lambda attempt: attempt.number):
        number = attempt.user_attrs.get(RETRY_OF)
        if number is None:
            number = attempt.number - n_retries
        else:
            n_retries += 1
        trials.setdefault(number, []).append(attempt)
    return trials


def trial_number(attempts: Iterable[FrozenTrial], attempt_number: int) -> int:
    """Number of the trial that the attempt belongs to."""
    grouped = group_attempts(attempts)
    return next(
        number
        for number, group in grouped.items()
        if any(attempt.number == attempt_number for attempt in group)
    )


def deaths(attempts: Iterable[FrozenTrial]) -> int:
    """Number of workers that died over these attempts: those that failed without a reason."""
    return sum(
        attempt.state is AttemptState.FAIL and REASON not in attempt.user_attrs for attempt in attempts
    )


def read_trial(number: int, attempts: Sequence[FrozenTrial], maximum_attempts: int) -> Trial:
    """Sum up a trial's attempts."""
    started = [attempt for attempt in attempts if SECONDS in attempt.user_attrs]
    final = next((attempt for attempt in attempts if attempt.state in FINISHED), None)
    spent = {
        "seconds": sum(attempt.user_attrs[SECONDS] for attempt in started),
        "attempts": len(started),
    }
    if final is None:
        given_up = deaths(attempts) >= maximum_attempts
        shown = started[-1] if started else attempts[-1]
        return Trial(
            number,
            TrialOutcome.given_up if given_up else TrialOutcome.open,
            dict(shown.params),
            reason=f"{deaths(attempts)} workers died over it" if given_up else "",
            **spent,
        )
    reason = final.user_attrs.get(REASON, "")
    outcome = TrialOutcome.complete
    if final.state is AttemptState.PRUNED:
        outcome = TrialOutcome.diverged if reason.startswith(DIVERGED) else TrialOutcome.pruned
    return Trial(
        number,
        outcome,
        dict(final.params),
        final.value if outcome is TrialOutcome.complete else None,
        dict(final.user_attrs.get(FACTS, {})),
        worker=final.user_attrs.get(WORKER, ""),
        reason=reason,
        **spent,
    )
