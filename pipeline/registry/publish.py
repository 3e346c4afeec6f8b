"""Logs a model folder to a stage's run and registers it."""

from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas

import pipeline
from pipeline.dynamics.model import DynamicsModel
from pipeline.logs.tuples import Trajectory
from pipeline.registry import dynamics_model
from pipeline.tracking import StageRun

# What loading a dynamics model imports; MLflow installs it where the model is served.
REQUIREMENTS = ("mlflow", "jax", "flax", "jaxkan", "numpy", "pandas", "polars", "pyarrow", "scipy")
EXAMPLE_HORIZON = 20  # rows that the input example asks for: a second at 20 Hz


def publish_dynamics_model(
    run: StageRun,
    folder: Path,
    model: DynamicsModel,
    registered_name: str,
    trajectory: Trajectory,
    name: str = "model",
    alias: str | None = None,
) -> None:
    """Log a model that `identify` or `close_loop` wrote, with its signature, as a new version of a registered model.

    It loads in one line wherever the tracking store is known:
    `mlflow.pyfunc.load_model("models:/<registered_name>/<version>")`.

    Args:
        run: The stage's run; without tracking nothing is done.
        folder: The model folder.
        model: What it holds.
        registered_name: Name in the registry.
        trajectory: Rows for the input example.
        name: Of the model in the run.
        alias: Of the new version.
    """
    n_measured = model.specification.lags + 2
    example = example_rows(model, trajectory, n_measured, EXAMPLE_HORIZON)
    run.model(
        code=Path(dynamics_model.__file__),
        package=Path(pipeline.__file__).parent,
        artifacts={dynamics_model.MODEL_FOLDER: folder},
        requirements=[f"{name}=={version(name)}" for name in REQUIREMENTS],
        registered_name=registered_name,
        example=example,
        name=name,
        alias=alias,
    )


def example_rows(
    model: DynamicsModel, trajectory: Trajectory, n_measured: int, horizon: int
) -> pandas.DataFrame:
    """Rows as the model takes them: `n_measured` measured ones, then `horizon` with commands alone."""
    rows = slice(0, n_measured + horizon)
    columns = {}
    for prefix, values in (("q", trajectory.q), ("qd", trajectory.qd), ("a", trajectory.a)):
        for number, joint in enumerate(model.specification.joints):
            column = values[rows, number].astype(np.float64)
            if prefix != "a":
                column[n_measured:] = np.nan
            columns[f"{prefix}_{joint}"] = column
    return pandas.DataFrame(columns)
