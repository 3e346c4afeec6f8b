"""A dynamics model as MLflow loads it (models from code): a table of rows in, predicted positions out.

MLflow stores this file beside the model folder and runs it when the model is loaded.
"""

from pathlib import Path
from typing import Any

import mlflow
import numpy as np
import pandas
from mlflow.pyfunc.model import PythonModel, PythonModelContext

from pipeline.dynamics.model.store import MODEL_FOLDER, load_model
from pipeline.effects.store import load_predictor
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory


class DynamicsPyfunc(PythonModel):
    """Open-loop prediction.

    Input: consecutive rows at the machine's rate with columns `q_<joint>`, `qd_<joint>`, `a_<joint>` (tuples of stage
    `ingest`). The first rows are measured, at least lags + 2 of them; in the rows to predict positions and velocities
    are empty (NaN) and only the commands count. Output: `q_<joint>` of those rows, rad or m. Effects around the network
    have all set in; the log begins with the first row.
    """

    def load_context(self, context: PythonModelContext) -> None:
        """Read the model folder."""
        folder = Path(context.artifacts[MODEL_FOLDER])
        specification = load_model(folder)[0].specification
        self.joints, self.dt_s = specification.joints, specification.dt_s
        self.predictor = load_predictor(folder, all_set_in=True)

    def predict(
        self, context: Any, model_input: pandas.DataFrame, params: dict[str, Any] | None = None
    ) -> pandas.DataFrame:
        """Predict the rows without positions.

        Raises:
            InputError: A column is missing, too few rows are measured, or rows to predict lie before measured ones.
        """
        q, qd, a = (self._columns(model_input, prefix) for prefix in ("q", "qd", "a"))
        measured = np.isfinite(q).all(axis=1)
        n_measured = int(measured.sum())
        if not measured[:n_measured].all():
            raise InputError(
                "the rows to predict must follow the measured ones; a position is missing before"
            )
        if n_measured < self.predictor.rows_before + 1:
            raise InputError(
                f"{n_measured} rows are measured; this model needs {self.predictor.rows_before + 1} before the first "
                "predicted one"
            )
        if not (np.isfinite(qd[:n_measured]).all() and np.isfinite(a[:-1]).all()):
            raise InputError("a velocity of a measured row, or a command, is missing")
        horizon = len(q) - n_measured
        if horizon == 0:
            return pandas.DataFrame(columns=[f"q_{joint}" for joint in self.joints], dtype=np.float64)
        row = np.arange(len(q))
        rows = Trajectory("", self.dt_s * row, row, q, qd, a, np.zeros(len(q), bool))
        predicted = self.predictor.predict(rows, np.array([n_measured - 1]), horizon)[0]
        return pandas.DataFrame(
            {f"q_{joint}": predicted[:, number] for number, joint in enumerate(self.joints)},
            index=model_input.index[n_measured:],
        )

    def _columns(self, table: pandas.DataFrame, prefix: str) -> np.ndarray:
        names = [f"{prefix}_{joint}" for joint in self.joints]
        missing = [name for name in names if name not in table]
        if missing:
            raise InputError(
                f"column {', '.join(missing)} is missing; columns seen: {', '.join(table.columns)}"
            )
        return table[names].to_numpy(np.float64)


mlflow.models.set_model(DynamicsPyfunc())
