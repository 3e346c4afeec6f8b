"""Errors and coverage of one predictor on held-out trajectories."""

from collections.abc import Sequence

import numpy as np

from benchmarks.identification.kinds import EnsemblePredictor
from pipeline.dynamics.evaluation.errors import (
    Predictor,
    one_step_rmse,
    open_loop_residuals,
    open_loop_rmse_80,
)
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.logs.tuples import Trajectory

LONG_HORIZON = 1000  # steps
LONG_STRIDE = 200  # rows between starts
COVERED_STEPS = {20: "1 s", 80: "4 s"}


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
    """By steps ahead and joint: share of positions inside the 90 % band, and the band's mean width, rad or m.

    Empty where the predictor does not say how sure it is.
    """
    if not isinstance(predictor, EnsemblePredictor):
        return {}
    found = predictor.band().coverage(held_out)
    return {
        str(step): {"covered": found.share[step - 1].tolist(), "width": found.width[step - 1].tolist()}
        for step in COVERED_STEPS
    }
