"""Figures of models beside those of references: who is best on what."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from pipeline.dynamics.evaluation.extrapolation import Extrapolation
from pipeline.dynamics.judgement import ModelJudgement

GROWTH_HORIZONS_S = (0.05, 0.5, 1.0, 2.0, 4.0, 10.0, 20.0, 50.0)
ONE_STEP, OPEN_LOOP = "one_step_rmse", "open_loop_rmse_80"
INDIFFERENT_BELOW = {
    "speed_ratio": 1.0,
    "speed_ratio_inside": 1.0,
}  # slower than the machine is as good as slower still


@dataclass(frozen=True)
class ComparedFigure:
    """One figure of one joint, smaller is better.

    Attributes:
        quantity: What was measured.
        joint: Index.
        values: By predictor; NaN where it could not be measured.
        indifferent_below: Values below this are as good as one another.
    """

    quantity: str
    joint: int
    values: Mapping[str, float]
    indifferent_below: float = 0.0

    def ranks(self) -> dict[str, float]:
        """What the predictors are ordered by."""
        return {
            name: np.inf if np.isnan(value) else max(value, self.indifferent_below)
            for name, value in self.values.items()
        }

    def best(self) -> list[str]:
        """The best predictors; several if they tie."""
        ranks = self.ranks()
        return [name for name, rank in ranks.items() if rank == min(ranks.values())]


def error_figures(judgements: Mapping[str, ModelJudgement]) -> list[ComparedFigure]:
    """One-step and open-loop errors (contract, section 3), rad or m."""
    return [
        ComparedFigure(
            quantity, j, {name: float(getattr(one.errors, quantity)[j]) for name, one in judgements.items()}
        )
        for quantity in (ONE_STEP, OPEN_LOOP)
        for j in range(n_joint(judgements))
    ]


def growth_figures(judgements: Mapping[str, ModelJudgement], dt_s: float) -> list[ComparedFigure]:
    """Error after several horizons, rad or m; the quantity is the horizon in seconds."""
    longest = len(next(iter(judgements.values())).growth.rmse)
    steps = [round(horizon_s / dt_s) for horizon_s in GROWTH_HORIZONS_S]
    return [
        ComparedFigure(
            f"{step * dt_s:g}",
            j,
            {name: float(one.growth.rmse[step - 1, j]) for name, one in judgements.items()},
        )
        for step in dict.fromkeys(steps)
        if 1 <= step <= longest
        for j in range(n_joint(judgements))
    ]


def extrapolation_figures(judgements: Mapping[str, ModelJudgement]) -> list[ComparedFigure]:
    """Behaviour outside the training distribution; what no predictor could be measured on is left out."""
    figures = [
        ComparedFigure(
            quantity.name,
            j,
            {name: float(getattr(one.extrapolation, quantity.name)[j]) for name, one in judgements.items()},
            INDIFFERENT_BELOW.get(quantity.name, 0.0),
        )
        for quantity in fields(Extrapolation)
        for j in range(n_joint(judgements))
    ]
    return [figure for figure in figures if not all(np.isnan(value) for value in figure.values.values())]


def reference_wins(
    judgements: Mapping[str, ModelJudgement], references: Collection[str], dt_s: float
) -> dict[str, int]:
    """On how many figures of each comparison some reference is better than every model."""
    compared: dict[str, Sequence[ComparedFigure]] = {
        "errors": error_figures(judgements),
        "error_growth": growth_figures(judgements, dt_s),
        "extrapolation": extrapolation_figures(judgements),
    }
    return {
        f"reference_wins.{name}": sum(set(figure.best()) <= set(references) for figure in figures)
        for name, figures in compared.items()
    }


def n_joint(judgements: Mapping[str, ModelJudgement]) -> int:
    """Joints of the machine."""
    return len(next(iter(judgements.values())).errors.one_step_rmse)
