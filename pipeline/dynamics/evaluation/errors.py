"""One-step and open-loop errors of any predictor on any trajectories (contract, section 3)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

OPEN_LOOP_HORIZON = 80  # steps
OPEN_LOOP_STRIDE = 20  # rows between window starts
WINDOWS_AT_ONCE = 4096  # per call of a predictor, so that memory does not grow with the log
DIVERGED = 1e6  # rad or m: larger and non-finite errors count as this, so that sums stay finite


class Predictor(Protocol):
    """Anything that predicts configurations from logs: a learned model, ARX, a model with effects added."""

    @property
    def rows_before(self) -> int:
        """Rows that must lie before a start row."""

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """Predict in open loop from measured rows.

        Args:
            trajectory: Measured rows. From each start row s, rows up to s may be used, and of the rows
                after it the commands (and stamps) only; the command of row s is the first that acts.
            starts: (n_windows,) start rows.
            horizon: Steps H.

        Returns:
            (n_windows, H, n_joint) float64: predictions for rows s+1 … s+H.
        """


@dataclass(frozen=True)
class PredictionErrors:
    """Errors over all given trajectories (contract, section 3).

    Attributes:
        one_step_rmse: (n_joint,) rad or m.
        open_loop_rmse_80: (n_joint,) rad or m.
        n_windows: Number of open-loop windows.
        n_steps: Number of one-step predictions.
    """

    one_step_rmse: np.ndarray
    open_loop_rmse_80: np.ndarray
    n_windows: int
    n_steps: int


def prediction_errors(
    predictor: Predictor, trajectories: Sequence[Trajectory], place: str = "logs"
) -> PredictionErrors:
    """Both errors; see `one_step_rmse` and `open_loop_rmse_80`.

    Args:
        trajectories: The test data.
        place: Origin of the data, for the message.

    Raises:
        InputError: No trajectory is long enough.
    """
    one_step, n_steps = one_step_rmse(predictor, trajectories, place)
    open_loop, n_windows = open_loop_rmse_80(predictor, trajectories, place)
    return PredictionErrors(one_step, open_loop, n_windows=n_windows, n_steps=n_steps)


def one_step_rmse(
    predictor: Predictor, trajectories: Sequence[Trajectory], place: str = "logs"
) -> tuple[np.ndarray, int]:
    """RMSE of q̂[t+1] − q[t+1] from measured history, over rows t = 40, 41, … of each trajectory.

    Returns:
        (n_joint,) rad or m, and the number of predictions.
    """
    return _rmse(predictor, trajectories, one_step_starts, 1, place)


def open_loop_rmse_80(
    predictor: Predictor, trajectories: Sequence[Trajectory], place: str = "logs"
) -> tuple[np.ndarray, int]:
    """RMSE over all steps of windows of 80 steps that start at rows 40, 60, 80, … as long as the window fits.

    Returns:
        (n_joint,) rad or m, and the number of windows.
    """
    return _rmse(predictor, trajectories, open_loop_starts, OPEN_LOOP_HORIZON, place)


def one_step_starts(n_rows: int) -> np.ndarray:
    """Rows t from which row t+1 is predicted."""
    return np.arange(FIRST_JUDGED_ROW, n_rows - 1)


def open_loop_starts(n_rows: int) -> np.ndarray:
    """Start rows s of the open-loop windows; the last predicted row is s + 80."""
    return np.arange(FIRST_JUDGED_ROW, n_rows - OPEN_LOOP_HORIZON, OPEN_LOOP_STRIDE)


def open_loop_residuals(
    predictor: Predictor, trajectory: Trajectory, starts: np.ndarray, horizon: int
) -> np.ndarray:
    """q̂ − q of windows of any length: (n_windows, horizon, n_joint) float64, finite (see `DIVERGED`)."""
    check_history(predictor)
    rows = starts[:, None] + 1 + np.arange(horizon)
    predicted = predictor.predict(trajectory, starts, horizon)
    return finite(predicted - np.asarray(trajectory.q, np.float64)[rows])


def finite(values: np.ndarray) -> np.ndarray:
    """The values clipped to ± `DIVERGED`; NaN becomes `DIVERGED`."""
    return np.clip(np.nan_to_num(values, nan=DIVERGED), -DIVERGED, DIVERGED)


def check_history(predictor: Predictor) -> None:
    """Raise InputError if the predictor needs more rows than lie before the first judged row."""
    if predictor.rows_before > FIRST_JUDGED_ROW:
        raise InputError(
            f"model: it needs {predictor.rows_before} rows of history, but errors are measured from row "
            f"{FIRST_JUDGED_ROW} of each trajectory on; identify it with at most {FIRST_JUDGED_ROW - 1} lags"
        )


def _rmse(
    predictor: Predictor,
    trajectories: Sequence[Trajectory],
    starts_of: Callable[[int], np.ndarray],
    horizon: int,
    place: str,
) -> tuple[np.ndarray, int]:
    squares, n_values, n_windows = 0.0, 0, 0
    for trajectory in trajectories:
        starts = starts_of(len(trajectory.q))
        for first in range(0, len(starts), WINDOWS_AT_ONCE):
            chunk = starts[first : first + WINDOWS_AT_ONCE]
            residuals = open_loop_residuals(predictor, trajectory, chunk, horizon)
            squares = squares + np.sum(residuals**2, axis=(0, 1))
        n_values += len(starts) * horizon
        n_windows += len(starts)
    if n_windows == 0:
        raise InputError(
            f"{place}: no trajectory is longer than {FIRST_JUDGED_ROW + horizon} rows, which a prediction over "
            f"{horizon} steps from row {FIRST_JUDGED_ROW} needs; give longer logs"
        )
    return np.sqrt(squares / n_values), n_windows
