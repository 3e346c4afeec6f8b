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
from pipeline.logs.tuples import Trajectory

LONG_HORIZON = 1000  # steps
LONG_STRIDE = 200  # rows between starts
COVERED_STEPS = (20, 80)  # 1 s and 4 s
BAND_QUANTILE = 1.645  # standard normal, of a 90 % band


@runtime_checkable
class Uncertain(Protocol):
    """A predictor that says how sure it is."""

    def predict_with_std(
        self, trajectory: Trajectory, starts: np.ndarray, horizon: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `Predictor.predict`, with the standard deviation of each predicted position, rad or m."""
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


def coverage(predictor: Predictor, held_out: Sequence[Trajectory]) -> dict[str, dict[str, list[float]]]:
    """By steps ahead: share of positions inside the 90 % band, and the band's mean width, rad or m, by joint.

    Empty where the predictor does not say how sure it is.
    """
    if not isinstance(predictor, Uncertain):
        return {}
    steps = np.array(COVERED_STEPS) - 1
    inside, widths = [], []
    for trajectory in held_out:
        starts = open_loop_starts(len(trajectory))
        predicted, std = predictor.predict_with_std(trajectory, starts, max(COVERED_STEPS))
        measured = trajectory.q[starts[:, None] + 1 + steps]
        half = BAND_QUANTILE * std[:, steps]
        inside.append(np.abs(predicted[:, steps] - measured) <= half)
        widths.append(2.0 * half)
    share, width = (np.concatenate(values).mean(axis=0) for values in (inside, widths))
    return {
        str(step): {"covered": share[k].tolist(), "width": width[k].tolist()}
        for k, step in enumerate(COVERED_STEPS)
    }
