"""Judgement of a model on rows that neither its training nor its selection saw, beside a linear ARX."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.errors import Predictor, prediction_errors
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass(frozen=True)
class OpenLoopPrediction:
    """One long open-loop prediction (paper, Fig. "Open-loop predictions").

    Attributes:
        trajectory: Name of the trajectory.
        t_s: Times of the predicted rows, s from the bag's start, shape (H,).
        measured: Positions, rad or m, shape (H, n_joint).
        predicted: The same as predicted from the row before the first, shape (H, n_joint).
        commands: In force up to each of these rows, shape (H, n_joint).
    """

    trajectory: str
    t_s: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    commands: np.ndarray


def judge(
    predictors: Mapping[str, Predictor], trajectories: Sequence[Trajectory], machine: MachineSpecification
) -> dict[str, object]:
    """Errors of several predictors on the same rows (contract, section 3).

    Returns:
        Per predictor's name `one_step_rmse` and `open_loop_rmse_80` by joint (rad or m), and once `n_windows`
        and `n_steps`.
    """
    metrics: dict[str, object] = {}
    for name, predictor in predictors.items():
        errors = prediction_errors(predictor, trajectories)
        metrics[name] = {
            "one_step_rmse": dict(zip(machine.joint_names, errors.one_step_rmse.tolist(), strict=True)),
            "open_loop_rmse_80": dict(
                zip(machine.joint_names, errors.open_loop_rmse_80.tolist(), strict=True)
            ),
        }
        metrics |= {"n_windows": errors.n_windows, "n_steps": errors.n_steps}
    return metrics


def long_prediction(
    predictor: Predictor, trajectories: Sequence[Trajectory], first_row: int, horizon: int
) -> OpenLoopPrediction:
    """Predict `horizon` steps of the longest trajectory in open loop, from `first_row` on; fewer if it is shorter."""
    trajectory = max(trajectories, key=len)
    horizon = min(horizon, len(trajectory) - first_row - 1)
    rows = slice(first_row + 1, first_row + 1 + horizon)
    predicted = predictor.predict(trajectory, np.array([first_row]), horizon)[0]
    return OpenLoopPrediction(
        trajectory.name,
        trajectory.t_s[rows],
        trajectory.q[rows],
        predicted,
        trajectory.a[first_row : first_row + horizon],
    )
