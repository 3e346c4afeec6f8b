"""The paper's table of selected dynamics models, with ours above the published ones."""

import csv
import dataclasses
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pipeline.dynamics.evaluation.inference_time import StepTime
from pipeline.dynamics.search.selection import ModelCandidate, SelectionRule
from pipeline.dynamics.settings import TrainingConfig
from pipeline.reporting.results.paper import KIND_NAMES, SELECTED_MODELS
from pipeline.reporting.table import Table

_COLUMNS = [
    "Prediction",
    "From",
    "Parameterization",
    "k",
    "H",
    "lr",
    "n_B",
    "L|eval at H = 80 [rad²]",
    "Parameters",
    "Step time [µs]",
    "Why",
]


class PublishedModel(NamedTuple):
    """The paper's model, as built and timed here."""

    n_parameters: int
    step_time: StepTime


@dataclass(frozen=True)
class SelectedModels:
    """Selection of one model kind.

    Attributes:
        kind: `<parameterization>_<target>`.
        winner: The selected trial.
        reason: Why it is preferred to the trial with the smallest error.
        shortlist: The trials within the margin.
        times: Measured step times by trial.
        published: The paper's model of this kind; None: the paper has none.
    """

    kind: str
    winner: ModelCandidate
    reason: str
    shortlist: list[ModelCandidate]
    times: dict[int, StepTime]
    published: PublishedModel | None


def published_training(kind: str) -> TrainingConfig:
    """Hyper-parameters that the paper selected; its table lacks the epochs."""
    name, lags, horizon, learning_rate, batch_size, _ = SELECTED_MODELS[kind]
    hidden = [int(units) for units in name.partition("(")[2].rstrip(")").split(",")]
    return TrainingConfig(hidden, lags, horizon, learning_rate, batch_size, maximum_epochs=1)


def selection_table(
    selections: Sequence[SelectedModels], rule: SelectionRule, profile: str, device: str
) -> Table:
    """The paper's table of selected models: a row of ours, then one of the published."""
    rows = []
    for selection in selections:
        winner, kind = selection.winner, selection.kind
        time = selection.times[winner.trial]
        ours = _row(kind, winner.training, winner.evaluation_loss, winner.n_parameters, time)
        rows.append([ours[0], f"ours, trial {winner.trial}", *ours[1:], selection.reason])
        if selection.published is not None:
            theirs = _row(kind, published_training(kind), SELECTED_MODELS[kind][5], *selection.published)
            rows.append([theirs[0], "paper", *theirs[1:], ""])
    preferred = ", then ".join(criterion.value for criterion in rule.prefer)
    n_calls = next(iter(selections[0].times.values())).n_calls
    return Table(
        f"Selected parameterizations and training hyperparameters, profile {profile}",
        _COLUMNS,
        rows,
        [
            f"Rule: of the trials whose L|eval is within {rule.margin:.1%} of the smallest, the one with the smallest "
            f"{preferred}.",
            "The paper's L|eval was measured on its own machine, so the two do not compare.",
            f"Step time: one compiled step of a single state, median (quartiles) of {n_calls} calls on {device}; "
            "the paper's networks are timed here, too.",
        ],
    )


def table_csv(table: Table) -> str:
    """The table as comma-separated values."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows(table.rows)
    return text.getvalue()


def record(selection: SelectedModels) -> dict[str, Any]:
    """A selection as plain data, with every trial within the margin."""
    return {
        "kind": selection.kind,
        "reason": selection.reason,
        "selected": _candidate_record(selection, selection.winner),
        "shortlist": [_candidate_record(selection, candidate) for candidate in selection.shortlist],
    }


def _candidate_record(selection: SelectedModels, candidate: ModelCandidate) -> dict[str, Any]:
    content = dataclasses.asdict(candidate)
    del content["inference_time_s"]
    return content | {"step_time": dataclasses.asdict(selection.times[candidate.trial])}


def _row(
    kind: str, training: TrainingConfig, evaluation_loss: float, n_parameters: int, step_time: StepTime
) -> list[str]:
    parameterization, prediction = KIND_NAMES[kind].split()
    quartiles = (step_time.lower_quartile_s, step_time.median_s, step_time.upper_quartile_s)
    lower, median, upper = (f"{1e6 * quartile:.1f}" for quartile in quartiles)
    return [
        prediction,
        f"{parameterization}({', '.join(map(str, training.hidden))})",
        str(training.lags),
        str(training.horizon),
        f"{training.learning_rate:g}",
        str(training.batch_size),
        f"{evaluation_loss:.3e}",
        str(n_parameters),
        f"{median} ({lower} to {upper})",
    ]
