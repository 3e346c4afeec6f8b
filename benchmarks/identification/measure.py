"""Errors and coverage of one predictor on held-out trajectories."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from pipeline.dynamics.evaluation.errors import (
    Predictor,
    one_step_rmse,
    open_loop_residuals,
    open_loop_rmse_80,
    open_loop_starts,
)
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.logs.tuples import Trajectory, validation_part

LONG_HORIZON = 1000  # steps
LONG_STRIDE = 200  # rows between starts
COVERED_STEPS = (20, 80)  # 1 s and 4 s
BAND_QUANTILE = 1.645  # standard normal, of a 90 % band


@runtime_checkable
class Uncertain(Protocol):
    """A predictor whose members disagree."""

    def spread(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """Standard deviation over members of what `Predictor.predict` predicts, of its shape, rad or m."""
        ...


def errors(predictor: Predictor, held_out: Sequence[Trajectory]) -> dict[str, list[float]]:
    """By name: `1`, `80` and `1000` steps, RMSE by joint over all steps of all windows, rad or m.

    Trajectories that are too short for the longest windows are left out of these; without any there is no such error.
    """
    found = {
        "1": one_step_rmse(predictor, held_out)[0].tolist(),
        "80": open_loop_rmse_80(predictor, held_out)[0].tolist(),
    }
    squares = []
    for trajectory in held_out:
        starts = np.arange(FIRST_JUDGED_ROW, len(trajectory) - LONG_HORIZON, LONG_STRIDE)
        if len(starts):
            squares.append(open_loop_residuals(predictor, trajectory, starts, LONG_HORIZON) ** 2)
    if squares:
        found[str(LONG_HORIZON)] = np.sqrt(np.concatenate(squares).mean(axis=(0, 1))).tolist()
    return found


def coverage(
    predictor: Predictor, learning: Sequence[Trajectory], held_out: Sequence[Trajectory]
) -> dict[str, dict[str, list[float]]]:
    """How often the 90 % band holds what is measured; empty where the predictor does not say how sure it is.

    The band's variance is the members' and the machine's own: what squared errors on the validation rows have beyond
    the members'.

    Returns:
        By steps ahead and joint: `covered`, the share inside; `width`, the band's mean width, rad or m; and
        `by_spread`, the share inside the band of the members alone.
    """
    if not isinstance(predictor, Uncertain):
        return {}
    error, spread = _errors_and_spreads(predictor, [validation_part(trajectory) for trajectory in learning])
    own_variance = np.maximum(np.mean(error**2 - spread**2, axis=0), 0.0)
    error, spread = _errors_and_spreads(predictor, held_out)
    half = BAND_QUANTILE * np.sqrt(spread**2 + own_variance)
    covered, by_spread = (np.mean(np.abs(error) <= bound, axis=0) for bound in (half, BAND_QUANTILE * spread))
    return {
        str(step): {
            "covered": covered[k].tolist(),
            "width": (2.0 * half[:, k].mean(axis=0)).tolist(),
            "by_spread": by_spread[k].tolist(),
        }
        for k, step in enumerate(COVERED_STEPS)
    }


def _errors_and_spreads(
    predictor: Predictor, trajectories: Sequence[Trajectory]
) -> tuple[np.ndarray, np.ndarray]:
    """(n_windows, len(COVERED_STEPS), n_joint) of all windows of the longest of these horizons."""
    assert isinstance(predictor, Uncertain)
    steps, horizon = np.array(COVERED_STEPS) - 1, max(COVERED_STEPS)
    errors_of, spreads = [], []
    for trajectory in trajectories:
        starts = open_loop_starts(len(trajectory))
        if len(starts):
            errors_of.append(open_loop_residuals(predictor, trajectory, starts, horizon)[:, steps])
            spreads.append(predictor.spread(trajectory, starts, horizon)[:, steps])
    return np.concatenate(errors_of), np.concatenate(spreads)
