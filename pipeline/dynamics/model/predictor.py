"""A learned model as a predictor on logged rows."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics, P
from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.stops import Stops
from pipeline.logs.tuples import Trajectory

CHUNK = 256  # windows per call: one compilation per horizon, whatever the number of windows


class LearnedPredictor:
    """Open-loop predictions of a model without hidden state, in float32.

    Args:
        parameters: Its parameters, θ.
        has_stops: Whether joints end at their limits, as they do in the environment that policies are trained in (or as
            far beyond as the log has shown them to be). A network alone goes on: few rows of a log tell it not to.
    """

    def __init__(self, model: Dynamics[P, History], parameters: P, has_stops: bool = True) -> None:
        self._model = model
        self._parameters = parameters

        def roll_out(parameters, q, qd, a, commands, lowest, highest):  # type: ignore[no-untyped-def]
            history = model.history_from_rows(q, qd, a)
            stops = Stops.of_log(model.specification, lowest, highest) if has_stops else None
            return model.roll_out(parameters, history, commands, stops)

        self._rollout = jax.jit(roll_out)

    @property
    def rows_before(self) -> int:
        """Lags + 1: the oldest command of the history is one row older than its oldest motion."""
        return self._model.specification.lags + 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `errors.Predictor.predict`."""
        return self.predict_with(self._parameters, trajectory, starts, horizon)

    def predict_with(
        self, parameters: P, trajectory: Trajectory, starts: np.ndarray, horizon: int
    ) -> np.ndarray:
        """`predict` with other parameters, on the same compilation."""
        predictions = np.empty((len(starts), horizon, trajectory.q.shape[1]))
        lowest, highest = np.fmin.accumulate(trajectory.q), np.fmax.accumulate(trajectory.q)
        for first in range(0, len(starts), CHUNK):
            chunk = starts[first : first + CHUNK]
            rows = chunk[:, None] + np.arange(-self.rows_before, 1)
            future = chunk[:, None] + np.arange(horizon)
            of_rows = (trajectory.q[rows], trajectory.qd[rows], trajectory.a[rows])
            arrays = (*of_rows, trajectory.a[future], lowest[chunk], highest[chunk])
            padded = [jnp.asarray(_padded(array), jnp.float32) for array in arrays]
            predicted = self._rollout(parameters, *padded)
            predictions[first : first + CHUNK] = np.asarray(predicted)[: len(chunk)]
        return predictions


def _padded(array: np.ndarray) -> np.ndarray:
    """The array with its first row repeated until CHUNK rows are there."""
    return np.concatenate([array, np.broadcast_to(array[:1], (CHUNK - len(array), *array.shape[1:]))])
