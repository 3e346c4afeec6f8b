"""How sure a nonlinear finite-impulse-response model is: the band that its predictions state, and whether it holds.

Members that saw different rows differ where logs say little. What they are off alike, noise above all, is in no
spread: validation rows show how much of the squared error remains beside it, step by step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.dynamics.evaluation.errors import OPEN_LOOP_HORIZON, OPEN_LOOP_STRIDE, open_loop_starts
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW, window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

NORMAL_90 = (
    1.6448536269514722  # half of the width of a normal distribution's 90 % band, in standard deviations
)


class Coverage(NamedTuple):
    """Of the 90 % band after 1 … H steps, (H, n_joint) each.

    Attributes:
        share: Of measured configurations that lie in the band.
        width: Mean of the whole band, rad or m.
    """

    share: np.ndarray
    width: np.ndarray


class PredictiveBand:
    """Predictions over `OPEN_LOOP_HORIZON` steps with their standard deviation."""

    def __init__(self, model: FirModel, parameters: Parameters, learning: Sequence[Trajectory]) -> None:
        """Measure on the validation rows of the logs that the model was trained on what remains beside the spread.

        Raises:
            InputError: They are too short.
        """
        alone, self._members = model.members(parameters)
        self._own, self._member = (
            LearnedPredictor(model, parameters),
            LearnedPredictor(alone, self._members[0]),
        )
        self._remainder = np.zeros((OPEN_LOOP_HORIZON, model.specification.n_joint))
        squares = []
        for trajectory in learning:
            starts = window_starts([trajectory], True, FIRST_JUDGED_ROW, OPEN_LOOP_HORIZON)[
                ::OPEN_LOOP_STRIDE
            ]
            if len(starts):
                predicted, deviation = self.predict(trajectory, starts)
                squares.append((predicted - measured(trajectory, starts)) ** 2 - deviation**2)
        if not squares:
            raise InputError(
                f"the band needs {OPEN_LOOP_HORIZON} validation rows in one piece after row {FIRST_JUDGED_ROW} of a "
                "trajectory; give longer logs"
            )
        self._remainder = np.maximum(np.concatenate(squares).mean(axis=0), 0.0)

    def predict(self, trajectory: Trajectory, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predictions and standard deviations, (n_windows, H, n_joint) each, rad or m; see `Predictor.predict`."""
        members = [
            self._member.predict_with(own, trajectory, starts, OPEN_LOOP_HORIZON) for own in self._members
        ]
        predicted = self._own.predict(trajectory, starts, OPEN_LOOP_HORIZON)
        return predicted, np.sqrt(np.var(members, axis=0, ddof=1) + self._remainder)

    def coverage(self, trajectories: Sequence[Trajectory]) -> Coverage:
        """On windows of other logs."""
        inside, widths = [], []
        for trajectory in trajectories:
            starts = open_loop_starts(len(trajectory))
            if len(starts):
                predicted, deviation = self.predict(trajectory, starts)
                inside.append(np.abs(predicted - measured(trajectory, starts)) <= NORMAL_90 * deviation)
                widths.append(2.0 * NORMAL_90 * deviation)
        return Coverage(np.concatenate(inside).mean(axis=0), np.concatenate(widths).mean(axis=0))


def measured(trajectory: Trajectory, starts: np.ndarray) -> np.ndarray:
    """(n_windows, H, n_joint): configurations of the predicted rows."""
    return trajectory.q[starts[:, None] + 1 + np.arange(OPEN_LOOP_HORIZON)]
