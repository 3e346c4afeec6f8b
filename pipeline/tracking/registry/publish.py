"""Log a model folder to a stage's run and register it."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import pipeline
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.store import MODEL_FOLDER
from pipeline.logs.tuples import Trajectory
from pipeline.tracking import StageRun, flatten_metrics

if TYPE_CHECKING:
    import pandas

    from pipeline.discrepancy.verdict.result import ClosedLoop
    from pipeline.dynamics.identify import Identified

CODE = Path(__file__).with_name("dynamics_model.py")  # MLflow runs it; importing it would import MLflow
# Packages that a dynamics model needs; MLflow installs them where the model is served.
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
        run: The stage's run; without tracking the call has no effect.
        folder: The model folder.
        model: The model in the folder.
        registered_name: Name in the registry.
        trajectory: Rows for the input example.
        name: Name of the model in the run.
        alias: Alias of the new version.
    """
    if not run.is_tracked:
        return
    n_measured = model.specification.lags + 2
    example = example_rows(model, trajectory, n_measured, EXAMPLE_HORIZON)
    run.model(
        code=CODE,
        package=Path(pipeline.__file__).parent,
        artifacts={MODEL_FOLDER: folder},
        requirements=[f"{name}=={version(name)}" for name in REQUIREMENTS],
        registered_name=registered_name,
        example=example,
        name=name,
        alias=alias,
    )


def publish_identified(
    run: StageRun, folder: Path, identified: "Identified", registered_name: str, trajectory: Trajectory
) -> None:
    """Log the metrics of an identified model, and the model that it wrote into `folder`."""
    run.metrics(flatten_metrics(identified.metrics))
    run.artifact(folder, "model")
    publish_dynamics_model(run, folder, identified.model, registered_name, trajectory)


def publish_closed_loop(
    run: StageRun, folder: Path, closed: "ClosedLoop", nominal: Sequence[Trajectory], machine_name: str
) -> None:
    """Log the errors of a closed loop, and both models that it wrote, each with a nested run of its errors.

    Args:
        run: The stage's run.
        folder: What `close_loop` wrote.
        closed: The same, in memory.
        nominal: The longest of these trajectories has the rows of the input example.
        machine_name: Goes into the registered model's name.
    """
    document, example = closed.document, max(nominal, key=len)
    run.metrics(flatten_metrics({"error": document["error"], "baselines": document["baselines"]}))
    for part in ("before", "after"):
        with run.nested(part) as nested:  # under the names that identify's runs have
            errors = {metric: values[part] for metric, values in document["error"].items()}
            nested.metrics(flatten_metrics({"model": errors}))
        name, registered = f"model_{part}", f"{machine_name}-closed_loop"
        publish_dynamics_model(run, folder / name, closed.model, registered, example, name, part)


def example_rows(
    model: DynamicsModel, trajectory: Trajectory, n_measured: int, horizon: int
) -> "pandas.DataFrame":
    """Example input: `n_measured` measured rows, then `horizon` rows with commands alone."""
    import pandas  # takes a second; only tracked runs come here

    rows = slice(0, n_measured + horizon)
    columns = {}
    for prefix, values in (("q", trajectory.q), ("qd", trajectory.qd), ("a", trajectory.a)):
        for number, joint in enumerate(model.specification.joints):
            column = values[rows, number].astype(np.float64)
            if prefix != "a":
                column[n_measured:] = np.nan
            columns[f"{prefix}_{joint}"] = column
    return pandas.DataFrame(columns)
