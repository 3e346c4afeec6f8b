"""The champion among a registered model's versions: the one with the smallest error relative to the linear ARX."""

import math
from collections.abc import Mapping
from typing import Any

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
    try:
        present = client.get_model_version_by_alias(name, ALIAS)
        best = score(client.get_run(present.run_id).data.metrics)
    except MlflowException:  # no version has it yet, or its run was deleted
        best = None
    if best is None or new <= best:
        client.set_registered_model_alias(name, ALIAS, version)
