"""Tables of the judgement: errors of every model and reference, the best marked, and a summary sentence."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.dynamics.comparison import (
    INDIFFERENT_BELOW,
    ONE_STEP,
    OPEN_LOOP,
    ComparedFigure,
    error_figures,
    extrapolation_figures,
    growth_figures,
)
from pipeline.dynamics.evaluation.extrapolation import SPEED_STEPS, ExtrapolationConfig
from pipeline.dynamics.judgement import ModelJudgement
from pipeline.dynamics.references.grey_box import GreyBoxPredictor
from pipeline.dynamics.references.narx import NarxPredictor
from pipeline.dynamics.training.data_split import HELD_OUT, VALIDATION
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.results.paper import KIND_NAMES
from pipeline.reporting.table import Table

REFERENCE_NAMES = {
    "arx_dq": "ARX Δq",
    "arx_dqdot": "ARX Δq̇",
    "narx": "NARX (FROLS)",
    "grey_box": "grey box",
}
JUDGED_ON = {
    HELD_OUT: "On a recording that neither training nor selection saw.",
    VALIDATION: "On the validation rows, which early stopping saw: nothing was held out.",
}
WITHOUT_STOPS = (
    "Predictions run through end stops here, as the references' do; those of `identify` stop there."
)
ERROR_LABELS = {ONE_STEP: "one step", OPEN_LOOP: "open loop, 80 steps"}
EXTRAPOLATION_LABELS = {  # quantity and unit; shares and ratios are dimensionless
    "left_limits": ("leaves its limits under constant command, share", ""),
    "beyond_median": ("beyond its limits, median", "{unit}"),
    "beyond_largest": ("beyond its limits, largest", "{unit}"),
    "moved_uncommanded": ("moves while only others are commanded, largest", "{unit}"),
    "drift_at_rest": ("drifts from rest without command, largest", "{unit}"),
    "residual_speed_median": ("speed after the stop, median", "{unit}/s"),
    "residual_speed_largest": ("speed after the stop, largest", "{unit}/s"),
    "creep_after_stop": ("creeps after the stop, largest", "{unit}"),
    "unbounded": ("unbounded rollouts, share", ""),
    "speed_ratio": ("largest speed / training's", ""),
    "speed_ratio_inside": ("largest speed / training's, inside the limits", ""),
}


@dataclass(frozen=True)
class ReferenceComparison:
    """Figures of several predictors, smaller is better.

    Attributes:
        title: Title of the table.
        rows: (quantity, joint, unit) and the value by predictor.
        references: Names of the references.
        notes: Footnotes.
        indifferent_below: By quantity, value below which all predictors count as equal.
    """

    title: str
    rows: Sequence[tuple[tuple[str, str, str], Mapping[str, float]]]
    references: Sequence[str]
    notes: Sequence[str] = ()
    indifferent_below: Mapping[str, float] = field(default_factory=dict)

    def won_by_references(self) -> list[tuple[str, str, list[str]]]:
        """Quantity, joint and best references (several if they tie), where these beat every model."""
        won = []
        for (quantity, joint, _), values in self.rows:
            best = self._best(quantity, values)
            if all(name in self.references for name in best):
                won.append((quantity, joint, best))
        return won

    def lost_to_references(self) -> dict[str, int]:
        """Number of figures on which a reference beats the model, by model."""
        lost: dict[str, int] = {}
        for (quantity, _, _), values in self.rows:
            ranks = self._ranks(quantity, values)
            best = min(ranks[reference] for reference in self.references)
            for name, rank in ranks.items():
                if name not in self.references:
                    lost[name] = lost.get(name, 0) + (best < rank)
        return lost

    def sentence(self) -> str:
        """A sentence on how many figures references win; the table tells which."""
        won, lost = self.won_by_references(), self.lost_to_references()
        n_figures = len(self.rows)
        if won:
            text = f"A reference is better than every model on {len(won)} of these {n_figures} figures."
        else:
            text = f"No reference is better than the best model on any of these {n_figures} figures."
        if len(lost) > 1:
            counts = ", ".join(f"{display_name(name)} on {count}" for name, count in lost.items())
            text += f" Taken alone, models are behind some reference so often: {counts}."
        return text

    def table(self) -> Table:
        """One row per figure, one column per predictor; the best is bold, a winning reference is named."""
        names = list(self.rows[0][1])
        rows = []
        for (quantity, joint, unit), values in self.rows:
            best = self._best(quantity, values)
            cells = [_cell(values[name], name in best) for name in names]
            rows.append([quantity, f"{joint} [{unit}]" if unit else joint, *cells, self._winner(best)])
        columns = ["Figure", "Joint", *(display_name(name) for name in names), "Winner"]
        return Table(
            self.title, columns, rows, [*self.notes, "Smaller is better; the best of a row is bold."]
        )

    def _winner(self, best: Sequence[str]) -> str:
        if all(name in self.references for name in best):
            return f"reference: {_names(best)}"
        return "tie" if any(name in self.references for name in best) else _names(best)

    def _best(self, quantity: str, values: Mapping[str, float]) -> list[str]:
        return self._figure(quantity, values).best()

    def _ranks(self, quantity: str, values: Mapping[str, float]) -> dict[str, float]:
        return self._figure(quantity, values).ranks()

    def _figure(self, quantity: str, values: Mapping[str, float]) -> ComparedFigure:
        return ComparedFigure(quantity, 0, values, self.indifferent_below.get(quantity, 0.0))

    def markdown(self) -> str:
        """The sentence, and the table below it."""
        return f"{self.sentence()}\n\n{self.table().markdown()}"

    def content(self) -> dict[str, Any]:
        """Sentence and table, for the report."""
        return {"sentence": self.sentence(), **json.loads(self.table().json())}

    def tidy(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows for CSV: one row per predictor, quantity and joint."""
        rows = [
            [name, quantity, joint, unit, repr(float(value))]
            for (quantity, joint, unit), values in self.rows
            for name, value in values.items()
        ]
        return ["predictor", "quantity", "joint", "unit", "value"], rows


def _rows(
    figures: Sequence[ComparedFigure],
    machine: MachineSpecification,
    label: Callable[[str], str],
    unit: Callable[[str], str] = lambda quantity: "{unit}",
) -> list[tuple[tuple[str, str, str], Mapping[str, float]]]:
    """With words for quantity, joint and unit."""
    return [
        (
            (
                label(figure.quantity),
                machine.joint_names[figure.joint],
                unit(figure.quantity).format(unit=machine.units[figure.joint]),
            ),
            figure.values,
        )
        for figure in figures
    ]


def error_comparison(
    judgements: Mapping[str, ModelJudgement],
    references: Sequence[str],
    machine: MachineSpecification,
    judged_on: str,
) -> ReferenceComparison:
    """One-step and open-loop errors (contract, section 3)."""
    any_ = next(iter(judgements.values())).errors
    rows = _rows(error_figures(judgements), machine, lambda quantity: ERROR_LABELS[quantity])
    title = (
        f"Root mean square errors over {any_.n_steps} single steps and {any_.n_windows} windows of 80 steps"
    )
    return ReferenceComparison(title, rows, references, [JUDGED_ON[judged_on], WITHOUT_STOPS])


def growth_comparison(
    judgements: Mapping[str, ModelJudgement],
    references: Sequence[str],
    machine: MachineSpecification,
    confidence: float,
) -> ReferenceComparison:
    """Error after several horizons; the CSV and the figure show the bands."""
    any_ = next(iter(judgements.values())).growth
    rows = _rows(growth_figures(judgements, machine.dt_s), machine, lambda horizon_s: f"after {horizon_s} s")
    note = (
        f"Root mean square over {any_.n_windows} overlapping windows; {100 * confidence:g} % bands (moving-block "
        f"bootstrap, {any_.n_blocks} independent stretches) stand in error_growth.csv."
    )
    return ReferenceComparison("Open-loop error at the end of the horizon", rows, references, [note])


def growth_rows(
    judgements: Mapping[str, ModelJudgement], machine: MachineSpecification
) -> tuple[list[str], list[list[str]]]:
    """Header and rows for CSV: the error with its band at every horizon, by predictor and joint."""
    rows = [
        [
            name,
            joint,
            str(step + 1),
            f"{(step + 1) * machine.dt_s:g}",
            *(f"{values[step, j]:.6g}" for values in (one.growth.rmse, one.growth.lower, one.growth.upper)),
        ]
        for name, one in judgements.items()
        for j, joint in enumerate(machine.joint_names)
        for step in range(len(one.growth.rmse))
    ]
    return ["predictor", "joint", "steps", "horizon_s", "rmse", "lower", "upper"], rows


def extrapolation_comparison(
    judgements: Mapping[str, ModelJudgement],
    references: Sequence[str],
    machine: MachineSpecification,
    config: ExtrapolationConfig,
) -> ReferenceComparison:
    """Behaviour under constant commands from random configurations."""
    rows = _rows(
        extrapolation_figures(judgements),
        machine,
        lambda quantity: EXTRAPOLATION_LABELS[quantity][0],
        lambda quantity: EXTRAPOLATION_LABELS[quantity][1],
    )
    notes = [
        f"From rest at random configurations inside the limits, {config.steps} steps of constant commands "
        f"({config.configurations} configurations per pattern); for stopping, {config.motion_steps} steps of "
        f"command and then zero; the speed is measured after {config.settle_steps} steps of zero command, over "
        f"{SPEED_STEPS} steps.",
        "No predictor is given the joint limits here: an environment adds end stops of its own.",
        "A speed ratio above 1 is faster than the machine ever was in the training rows; values below 1 are alike.",
    ]
    ratios = {EXTRAPOLATION_LABELS[name][0]: floor for name, floor in INDIFFERENT_BELOW.items()}
    return ReferenceComparison("Behaviour outside the training distribution", rows, references, notes, ratios)


def narx_table(predictor: NarxPredictor, machine: MachineSpecification) -> Table:
    """The selected terms of every joint, strongest first."""
    names = predictor.term_names(machine.joint_names)
    rows = []
    for j, joint in enumerate(machine.joint_names):
        ratios = predictor.error_reduction_ratios[:, j]
        for i in np.argsort(-ratios, kind="stable")[: int(np.sum(ratios > 0))]:
            rows.append([joint, names[i], f"{predictor.coefficients[i, j]:.4g}", f"{100 * ratios[i]:.3f} %"])
    note = "ERR: error reduction ratio, the share of the next step's motion that the term explains."
    return Table("Terms of the NARX model", ["Joint", "Term", "Coefficient", "ERR"], rows, [note])


def grey_box_table(predictor: GreyBoxPredictor, machine: MachineSpecification) -> Table:
    """Dead time, lag and gains of every joint."""
    rows = [
        [
            f"{joint} [{unit}/s]",
            f"{predictor.dead_time_s[j]:.3f}",
            f"{predictor.lag_s[j]:.3f}",
            f"{predictor.gain_positive[j]:.4g}",
            f"{predictor.gain_negative[j]:.4g}",
        ]
        for j, (joint, unit) in enumerate(zip(machine.joint_names, machine.units, strict=True))
    ]
    columns = ["Joint", "Dead time [s]", "Lag [s]", "Speed at command 1", "Speed at command -1"]
    return Table("Parameters of the grey-box model", columns, rows)


def display_name(name: str) -> str:
    """Name in tables and figures."""
    return REFERENCE_NAMES.get(name) or KIND_NAMES.get(name, name)


def _names(predictors: Sequence[str]) -> str:
    return ", ".join(display_name(name) for name in predictors)


def _cell(value: float, best: bool) -> str:
    text = "–" if np.isnan(value) else f"{value:.3g}"
    return f"**{text}**" if best else text
