"""Selection of a model among the trials (paper, section "Training and evaluation of models for the arm dynamics").

"Since the top ranked models only differ by a slight margin with respect to L|eval, we filter those with higher
lags k and prefer smaller models due to their faster inference time." As a rule: of the models within a relative margin
of the best L|eval, the first in the order of the criteria `prefer` is selected.
"""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.dynamics.settings import TrainingConfig
from pipeline.errors import InputError


class Criterion(enum.StrEnum):
    """Criteria of which small values are preferred."""

    lags = "lags"
    n_parameters = "n_parameters"
    inference_time = "inference_time"
    evaluation_loss = "evaluation_loss"


_PREFERRED = {
    Criterion.lags: "fewer lags",
    Criterion.n_parameters: "fewer parameters",
    Criterion.inference_time: "a shorter inference time",
    Criterion.evaluation_loss: "a smaller L|eval",
}


@dataclass
class SelectionRule:
    """Section `search.selection`.

    Attributes:
        margin: Models whose L|eval is at most (1 + margin) times the smallest count as equal.
        prefer: Criteria of the choice among these; a later one decides ties of the earlier ones. L|eval and then the
            order of the trials decide the remaining ties.
    """

    margin: float
    prefer: list[Criterion]

    def __post_init__(self) -> None:
        if isinstance(self.margin, str):
            return  # OmegaConf builds the node first and the object later
        if not (math.isfinite(self.margin) and self.margin >= 0):
            raise InputError(f"search.selection.margin is {self.margin}; it must be finite and not negative")
        if len(set(self.prefer)) < len(self.prefer):
            names = ", ".join(Criterion(criterion).value for criterion in self.prefer)
            raise InputError(f"search.selection.prefer is [{names}]; list each criterion once")


@dataclass(frozen=True)
class ModelCandidate:
    """A trained model of the search.

    Attributes:
        trial: Number within the study.
        training: Hyper-parameters.
        evaluation_loss: L|eval, rad².
        n_parameters: Number of the network's parameters.
        inference_time_s: Median time of one step; NaN if not measured.
    """

    trial: int
    training: TrainingConfig
    evaluation_loss: float
    n_parameters: int
    inference_time_s: float = math.nan

    def value(self, criterion: Criterion) -> float:
        """Value of the criterion."""
        return {
            Criterion.lags: float(self.training.lags),
            Criterion.n_parameters: float(self.n_parameters),
            Criterion.inference_time: self.inference_time_s,
            Criterion.evaluation_loss: self.evaluation_loss,
        }[criterion]


def best(candidates: Sequence[ModelCandidate]) -> ModelCandidate:
    """The candidate with the smallest L|eval; among equal ones the earliest.

    Raises:
        InputError: if there are no candidates.
    """
    if not candidates:
        raise InputError("select: no trial of the search was completed; search with other hyper-parameters")
    return min(candidates, key=lambda candidate: (candidate.evaluation_loss, candidate.trial))


def within_margin(candidates: Sequence[ModelCandidate], rule: SelectionRule) -> list[ModelCandidate]:
    """Candidates within the margin, the best included, in the order of the trials."""
    limit = (1.0 + rule.margin) * best(candidates).evaluation_loss
    good = [candidate for candidate in candidates if candidate.evaluation_loss <= limit]
    return sorted(good, key=lambda candidate: candidate.trial)


def select(candidates: Sequence[ModelCandidate], rule: SelectionRule) -> ModelCandidate:
    """The candidate that the rule selects.

    Raises:
        InputError: if there are no candidates.
        ValueError: if the rule compares an inference time that was not measured.
    """
    good = within_margin(candidates, rule)
    if Criterion.inference_time in rule.prefer and any(
        math.isnan(candidate.inference_time_s) for candidate in good
    ):
        raise ValueError("select: a candidate within the margin has no inference time; measure it first")
    return min(
        good,
        key=lambda candidate: (
            *(candidate.value(criterion) for criterion in rule.prefer),
            candidate.evaluation_loss,
            candidate.trial,
        ),
    )


def explain(winner: ModelCandidate, candidates: Sequence[ModelCandidate], rule: SelectionRule) -> str:
    """Why `winner` was selected instead of the candidate with the smallest L|eval, in one sentence."""
    first = best(candidates)
    if winner.trial == first.trial:
        return f"The best L|eval, and none within {rule.margin:.1%} of it was preferable."
    decided = next(
        criterion for criterion in rule.prefer if winner.value(criterion) != first.value(criterion)
    )
    worse = winner.evaluation_loss / first.evaluation_loss - 1.0
    return (
        f"Preferred to the best, trial {first.trial} with {first.evaluation_loss:.3e}: {worse:.1%} worse, within the "
        f"margin of {rule.margin:.1%}, and {_PREFERRED[decided]} ({_shown(winner, decided)} instead of "
        f"{_shown(first, decided)})."
    )


def _shown(candidate: ModelCandidate, criterion: Criterion) -> str:
    if criterion is Criterion.inference_time:
        return f"{1e6 * candidate.inference_time_s:.1f} µs"
    return f"{candidate.value(criterion):.6g}"
