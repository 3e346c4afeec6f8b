"""The champion among the versions of a registered model."""

import pytest
from mlflow.exceptions import MlflowException

from pipeline.tracking.champion import promote_if_better, score


def metrics(boom: float, arm: float) -> dict[str, float]:
    """A model's errors in rad and m beside those of an ARX, 0.1 rad and 0.004 m."""
    return {
        "model.open_loop_rmse_80.boom": boom,
        "model.open_loop_rmse_80.arm": arm,
        "arx.open_loop_rmse_80.boom": 0.1,
        "arx.open_loop_rmse_80.arm": 0.004,
        "evaluation_loss": 1.0,
    }


def test_the_score_is_the_mean_ratio_to_the_reference() -> None:
    assert score(metrics(0.05, 0.004)) == pytest.approx(0.5**0.5)
    assert score(metrics(0.1, 0.004)) == pytest.approx(1.0)
    assert score({"evaluation_loss": 1.0}) is None
    assert score(metrics(float("nan"), 0.004)) is None


class Registry:
    """What `promote_if_better` asks of MLflow, in memory."""

    def __init__(self) -> None:
        self.runs: dict[str, dict[str, float]] = {}
        self.alias: str | None = None

    def get_run(self, run_id: str) -> object:
        data = type("Data", (), {"metrics": self.runs[run_id]})
        return type("Run", (), {"data": data})

    def get_model_version_by_alias(self, name: str, alias: str) -> object:
        if self.alias is None:
            raise MlflowException("no such alias")
        return type("Version", (), {"run_id": self.alias})

    def set_registered_model_alias(self, name: str, alias: str, version: str) -> None:
        assert (name, alias) == ("m-mlp_dqdot", "champion")
        self.alias = version


def test_a_better_version_takes_the_alias_a_worse_one_does_not() -> None:
    registry, history = Registry(), []
    for version, boom in (("1", 0.05), ("2", 0.06), ("3", 0.04), ("4", float("nan"))):
        registry.runs[version] = metrics(boom, 0.002)
        promote_if_better(registry, "m-mlp_dqdot", version, version)
        history.append(registry.alias)
    assert history == ["1", "1", "3", "3"]
