"""What the stages left in the artifacts folder, read back for tables and figures."""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError


@dataclass(frozen=True)
class ModelResult:
    """A dynamics model: content of `artifacts/identify/<kind>`."""

    kind: str  # <parameterization>_<target>
    specification: dict[str, Any]
    lineage: dict[str, Any]
    metrics: dict[str, Any]
    open_loop: dict[str, np.ndarray]

    @property
    def architecture(self) -> str:
        """As the paper writes it, `MLP(512, 128)`."""
        hidden = ", ".join(str(units) for units in self.specification["hidden"])
        return f"{self.specification['parameterization'].upper()}({hidden})"


@dataclass(frozen=True)
class JudgementResult:
    """A model beside the references: content of `artifacts/judge/<kind>`."""

    kind: str
    comparisons: dict[str, dict[str, Any]]  # errors, error_growth, extrapolation: sentence and table
    figures: dict[str, bytes]  # SVG by name


@dataclass(frozen=True)
class ControllerResult:
    """One controller of one seed: `artifacts/ppo/<kind>/seed_<n>` and its evaluation."""

    kind: str
    seed: int
    curve: list[dict[str, float]]
    metrics: dict[str, float]  # over the evaluation episodes
    success_rates: np.ndarray
    evaluation: Path  # folder of traces and episodes


@dataclass(frozen=True)
class ClosedLoopResult:
    """The closed loop and what its seal said: content of `artifacts/close_loop`."""

    document: dict[
        str, Any
    ]  # contract, section 4; or a `note` where there was nothing to close the loop with
    judgement: dict[str, Any]  # of the stage unseal; or a `note` where there is no seal
    page: Path  # the loop's own report


@dataclass(frozen=True)
class PipelineResults:
    """Everything that the report shows."""

    quality: dict[str, Any]
    models: list[ModelResult]
    judgements: list[JudgementResult]
    controllers: list[ControllerResult]
    closed_loop: ClosedLoopResult

    def controllers_of(self, kind: str) -> list[ControllerResult]:
        """The controllers synthesised on one model, by seed."""
        return sorted((c for c in self.controllers if c.kind == kind), key=lambda controller: controller.seed)


def read_results(artifacts: Path, kinds: Sequence[str], seeds: Sequence[int]) -> PipelineResults:
    """Read what the stages wrote.

    Args:
        artifacts: The folder that they write into.
        kinds: Model kinds, `<parameterization>_<target>`.
        seeds: Seeds of the controllers on each.

    Raises:
        InputError: a file of a stage is missing or damaged.
    """
    models = [_model(artifacts / "identify" / kind) for kind in kinds]
    controllers = [
        _controller(artifacts / "ppo" / kind / f"seed_{seed}", artifacts) for kind in kinds for seed in seeds
    ]
    judgements = [_judgement(artifacts / "judge" / kind) for kind in kinds]
    quality = _json(artifacts / "ingest/sessions/quality.json")
    return PipelineResults(quality, models, judgements, controllers, _closed_loop(artifacts / "close_loop"))


def _model(folder: Path) -> ModelResult:
    meta = _json(folder / "meta.json")
    with np.load(_existing(folder / "open_loop.npz"), allow_pickle=False) as content:
        open_loop = dict(content)
    return ModelResult(
        folder.name, meta["specification"], meta["metadata"], _json(folder / "metrics.json"), open_loop
    )


def _judgement(folder: Path) -> JudgementResult:
    figures = {path.stem: path.read_bytes() for path in sorted((folder / "figures").glob("*.svg"))}
    return JudgementResult(folder.name, _json(folder / "comparisons.json"), figures)


def _closed_loop(folder: Path) -> ClosedLoopResult:
    document, judgement = (_json(folder / name) for name in ("closed_loop.json", "judgement.json"))
    return ClosedLoopResult(document, judgement, folder / "report.html")


def _controller(folder: Path, artifacts: Path) -> ControllerResult:
    kind = folder.parent.name
    evaluation = artifacts / "evaluate_brax" / f"ppo_{kind}" / folder.name
    with _existing(folder / "curves.csv").open(newline="") as file:
        curve = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    return ControllerResult(
        kind,
        int(folder.name.removeprefix("seed_")),
        curve,
        _json(evaluation / "metrics.json"),
        np.loadtxt(_existing(evaluation / "success_rates.csv"), delimiter=",", ndmin=2),
        evaluation,
    )


def _json(path: Path) -> dict[str, Any]:
    try:
        return json.loads(_existing(path).read_text())
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not JSON ({error}); run the stage that writes it again") from error


def _existing(path: Path) -> Path:
    if not path.exists():
        raise InputError(f"{path}: no such file; run the stage that writes it first (dvc repro)")
    return path
