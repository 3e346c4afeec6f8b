"""Reader of the stages' outputs in the artifacts folder, for tables and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.reporting.results.controllers import ControllerResult, read_controllers
from pipeline.reporting.results.deployments import Deployment, files_of, read_deployments
from pipeline.reporting.results.files import read_json, require_file


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
class ClosedLoopResult:
    """The closed loop and the judgement by its seal: content of `artifacts/close_loop`."""

    document: dict[str, Any]  # contract, section 4; or a `note` if measured logs are missing
    judgement: dict[str, Any]  # of the stage unseal; or a `note` without a seal
    page: Path  # the loop's report
    repair: dict[str, Any] | None = None  # contract, section 3; or a `note` where nothing was repaired


@dataclass(frozen=True)
class PipelineResults:
    """All content of the report."""

    quality: dict[str, Any]
    models: list[ModelResult]
    judgements: list[JudgementResult]
    controllers: list[ControllerResult]
    closed_loop: ClosedLoopResult
    deployments: list[Deployment] = field(default_factory=list)
    in_field: dict[str, Any] | None = None  # table of Sim2Real of the simulated machine in the field


def read_results(
    artifacts: Path,
    kinds: Sequence[str],
    controllers: Mapping[str, Sequence[int]],
    in_field: str | None = None,
) -> PipelineResults:
    """Read the stages' outputs.

    Args:
        artifacts: Folder of the stages' outputs.
        kinds: Model kinds, `<parameterization>_<target>`.
        controllers: Names and seeds of the required controllers.
        in_field: File of a table of Sim2Real that was made in the field.

    Raises:
        InputError: a file of a stage is missing or damaged.
    """
    models = [_model(artifacts / "identify" / kind) for kind in kinds]
    judgements = [_judgement(artifacts / "judge" / kind) for kind in kinds]
    quality = read_json(artifacts / "ingest/sessions/quality.json")
    evaluated = read_controllers(artifacts, controllers)
    return PipelineResults(
        quality,
        models,
        judgements,
        evaluated,
        replace(
            read_closed_loop(artifacts / "close_loop"), repair=read_json(artifacts / "repair/repair.json")
        ),
        read_deployments(artifacts, evaluated),
        None if in_field is None else read_json(Path(in_field)),
    )


def files_read(artifacts: Path, results: PipelineResults) -> list[Path]:
    """Files and folders from which the results were read."""
    return [
        *(artifacts / "identify" / model.kind / "parameters.msgpack" for model in results.models),
        *(artifacts / "judge" / model.kind / "comparisons.json" for model in results.models),
        *files_of(artifacts, results.controllers, results.deployments),
        *(artifacts / "close_loop" / name for name in ("closed_loop.json", "judgement.json")),
        artifacts / "repair/repair.json",
        artifacts / "pictures",
    ]


def _model(folder: Path) -> ModelResult:
    meta = read_json(folder / "meta.json")
    with np.load(require_file(folder / "open_loop.npz"), allow_pickle=False) as content:
        open_loop = dict(content)
    return ModelResult(
        folder.name, meta["specification"], meta["metadata"], read_json(folder / "metrics.json"), open_loop
    )


def _judgement(folder: Path) -> JudgementResult:
    figures = {path.stem: path.read_bytes() for path in sorted((folder / "figures").glob("*.svg"))}
    return JudgementResult(folder.name, read_json(folder / "comparisons.json"), figures)


def read_closed_loop(folder: Path) -> ClosedLoopResult:
    """What `close_loop` and `unseal` left in one folder."""
    document, judgement = (read_json(folder / name) for name in ("closed_loop.json", "judgement.json"))
    return ClosedLoopResult(document, judgement, folder / "report.html")
