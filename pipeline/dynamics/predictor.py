"""A learned model as a predictor on logged rows."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters
from pipeline.dynamics.rollout import rollout
from pipeline.logs.tuples import Trajectory

CHUNK = 256  # windows per call: one compilation per horizon, whatever the number of windows


class LearnedPredictor:
    """Open-loop predictions of a `DynamicsModel` with its parameters, in float32."""

    def __init__(self, model: DynamicsModel, parameters: Parameters) -> None:
        self._model = model
        self._parameters = parameters
        self._rollout = jax.jit(
            lambda parameters, q, qd, a, commands: rollout(
                model, parameters, model.history_from_rows(q, qd, a), commands
            )
        )

    @property
    def rows_before(self) -> int:
        """Lags + 1: the oldest command of the history is one row older than its oldest motion."""
        return self._model.specification.lags + 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `errors.Predictor.predict`."""
        predictions = np.empty((len(starts), horizon, trajectory.q.shape[1]))
        for first in range(0, len(starts), CHUNK):
            chunk = starts[first : first + CHUNK]
            rows = chunk[:, None] + np.arange(-self.rows_before, 1)
            future = chunk[:, None] + np.arange(horizon)
            arrays = (trajectory.q[rows], trajectory.qd[rows], trajectory.a[rows], trajectory.a[future])
            padded = [jnp.asarray(_padded(array), jnp.float32) for array in arrays]
            predicted = self._rollout(self._parameters, *padded)
            predictions[first : first + CHUNK] = np.asarray(predicted)[: len(chunk)]
        return predictions


def _padded(array: np.ndarray) -> np.ndarray:
    """The array with its first row repeated until CHUNK rows are there."""
    return np.concatenate([array, np.broadcast_to(array[:1], (CHUNK - len(array), *array.shape[1:]))])
