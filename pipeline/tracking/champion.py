"""The champion among a registered model's versions.

Of dynamics models it is the one with the smallest error relative to the linear ARX. Of policies a person says so.
"""

import math
from collections.abc import Mapping
from typing import Any

from pipeline.errors import InputError

ALIAS = "champion"
MODEL, REFERENCE = "model.open_loop_rmse_80.", "arx.open_loop_rmse_80."


def score(metrics: Mapping[str, float]) -> float | None:
    """Geometric mean over joints of the model's 4-second error over the ARX's on the same rows: smaller is better.

    The ratio has no unit, so joints in rad and in m count alike. The ARX removes most of the rows' difficulty.
    None if a metric is missing.
    """
    ratios = [
        metrics[f"{MODEL}{joint}"] / metrics[f"{REFERENCE}{joint}"]
        for joint in (name.removeprefix(MODEL) for name in metrics if name.startswith(MODEL))
        if metrics.get(f"{REFERENCE}{joint}", 0.0) > 0.0
    ]
    if not ratios or not all(ratio > 0.0 and math.isfinite(ratio) for ratio in ratios):
        return None
    return math.exp(math.fsum(math.log(ratio) for ratio in ratios) / len(ratios))


def promote_if_better(client: Any, name: str, version: str, run_id: str) -> None:
    """Move the alias to a new version of registered model `name`, unless its present version is better."""
    from mlflow.exceptions import MlflowException

    new = score(client.get_run(run_id).data.metrics)
    if new is None:
        return
    present = champion_version(client, name)
    try:
        best = None if present is None else score(client.get_run(present.run_id).data.metrics)
    except MlflowException:  # its run was deleted
        best = None
    if best is None or new <= best:
        client.set_registered_model_alias(name, ALIAS, version)


FORMER = "former"  # tag of a version: the one that was champion before it


def champion_version(client: Any, name: str) -> Any | None:
    """The version that has the alias; None where there is none."""
    from mlflow.exceptions import MlflowException

    try:
        return client.get_model_version_by_alias(name, ALIAS)
    except MlflowException:
        return None


def add_version(client: Any, name: str, run_id: str, folder: str) -> str:
    """A new version of registered model `name` from a folder among the run's artifacts; its number."""
    from mlflow.exceptions import MlflowException

    try:
        client.get_registered_model(name)
    except MlflowException:
        client.create_registered_model(name)
    source = f"{client.get_run(run_id).info.artifact_uri}/{folder}"
    return str(client.create_model_version(name, source, run_id).version)


def crown(client: Any, name: str, version: str) -> None:
    """Give a version the alias; it remembers the version that had it."""
    former = champion_version(client, name)
    if former is not None:
        client.set_model_version_tag(name, version, FORMER, str(former.version))
    client.set_registered_model_alias(name, ALIAS, version)


def roll_back(client: Any, name: str) -> tuple[str, str]:
    """Give the alias back to the version that had it before; the numbers of the present one and of that one.

    Raises:
        InputError: No version has the alias, or none had it before.
    """
    present = champion_version(client, name)
    former = None if present is None else present.tags.get(FORMER)
    if present is None or former is None:
        raise InputError(f"{name}: no champion before the present one is known; promote one first")
    client.set_registered_model_alias(name, ALIAS, former)
    return str(present.version), former
