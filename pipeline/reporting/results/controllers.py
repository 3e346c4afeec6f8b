"""Reader of evaluated controllers: `artifacts/evaluate_brax/<algorithm>_<model kind>/seed_<n>`."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.reporting.results.files import read_json, require_file
from pipeline.reporting.results.paper import ALGORITHM_NAMES, KIND_NAMES

TRAINED = (
    "ppo",
    "apg",
    "ppo_warm",
)  # algorithms that are trained, each in its folder of artifacts; the others plan
IN_REPRO = ("apg", "ppo_warm")  # of these, what `dvc repro` trains


@dataclass(frozen=True)
class ControllerResult:
    """One controller of one seed.

    Attributes:
        algorithm: a key of `ALGORITHM_NAMES`.
        kind: model kind, a key of `KIND_NAMES`.
        seed: seed of its training or planning.
        metrics: over the evaluation episodes.
        success_rates: over the paper's grid of thresholds, shape (17, 8).
        evaluation: folder of traces and episodes.
        curve: points of its training; empty for a planner.
        meta: `meta.json` of its policy, or section `planning` of a planner's `metrics.json`.
    """

    algorithm: str
    kind: str
    seed: int
    metrics: dict[str, float]
    success_rates: np.ndarray
    evaluation: Path
    curve: list[dict[str, float]]
    meta: dict[str, Any]

    @property
    def name(self) -> str:
        """Name of the folder, which the seeds of one controller share."""
        return f"{self.algorithm}_{self.kind}"

    @property
    def title(self) -> str:
        """Name in the paper's form, `PPO MLP Δq̇`."""
        return controller_title(self.name)


def controller_title(name: str) -> str:
    """`PPO MLP Δq̇` for `ppo_mlp_dqdot`."""
    algorithm, kind = split_name(name)
    return f"{ALGORITHM_NAMES[algorithm]} {KIND_NAMES[kind]}"


def split_name(name: str) -> tuple[str, str]:
    """Algorithm and model kind of a folder's name.

    Raises:
        InputError: the folder is not a controller's.
    """
    for kind in KIND_NAMES:
        algorithm = name.removesuffix(f"_{kind}")
        if algorithm in ALGORITHM_NAMES and algorithm != name:
            return algorithm, kind
    raise InputError(
        f"evaluate_brax/{name}: no controller's folder; expected ALGORITHM_KIND, ALGORITHM one of "
        f"{', '.join(ALGORITHM_NAMES)}, KIND one of {', '.join(KIND_NAMES)}"
    )


def in_order(names: Iterable[str]) -> list[str]:
    """Names of controllers in the order of the paper's tables: by algorithm, then by model kind."""
    algorithms, kinds = list(ALGORITHM_NAMES), list(KIND_NAMES)

    def place(name: str) -> tuple[int, int]:
        algorithm, kind = split_name(name)
        return algorithms.index(algorithm), kinds.index(kind)

    return sorted(names, key=place)


def by_controller(controllers: Sequence[ControllerResult]) -> dict[str, list[ControllerResult]]:
    """Controllers by name, sorted by seed."""
    return {
        name: sorted((c for c in controllers if c.name == name), key=lambda controller: controller.seed)
        for name in in_order({controller.name for controller in controllers})
    }


def controllers_of(cells: Mapping[str, Any]) -> dict[str, list[int]]:
    """Names and seeds of the controllers that `dvc repro` makes.

    Args:
        cells: result of `cells.read_controller_cells`: models, targets, seeds, and for iCEM icem_variants, icem_models,
            icem_targets, icem_seeds.
    """
    kinds = _kinds(cells["models"], cells["targets"])
    trained = {f"{algorithm}_{kind}": list(cells["seeds"]) for algorithm in IN_REPRO for kind in kinds}
    if not cells.get("icem_variants"):
        return trained
    planned = _kinds(cells["icem_models"], cells["icem_targets"])
    names = [f"{variant}_{kind}" for variant in cells["icem_variants"] for kind in planned]
    return {name: list(cells["icem_seeds"]) for name in names} | trained


def _kinds(models: Sequence[str], targets: Sequence[str]) -> list[str]:
    return [f"{model}_{target}" for model in models for target in targets]


def read_controllers(artifacts: Path, required: Mapping[str, Sequence[int]]) -> list[ControllerResult]:
    """Read every evaluation in the artifacts folder.

    Args:
        artifacts: folder of the stages' outputs.
        required: required names and seeds. Other seeds of these names come from an earlier run and are ignored. For
            other names, metrics without traces are ignored, as git keeps them from an earlier run.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = artifacts / "evaluate_brax"
    found = {path.name for path in folder.glob("*/") if any(path.glob("seed_*/traces.npz"))}
    controllers = [
        _read(artifacts, name, f"seed_{seed}") for name, seeds in required.items() for seed in seeds
    ]
    for name in sorted(found - set(required)):
        finished = sorted(path.parent.name for path in (folder / name).glob("seed_*/traces.npz"))
        controllers += [_read(artifacts, name, seed) for seed in finished]
    return controllers


def _read(artifacts: Path, name: str, seed: str) -> ControllerResult:
    algorithm, kind = split_name(name)
    evaluation = artifacts / "evaluate_brax" / name / seed
    trained = algorithm in TRAINED
    training = artifacts / algorithm / kind / seed
    metrics = read_json(evaluation / "metrics.json")
    planning = metrics.pop("planning", {})
    if not trained and not planning:
        raise InputError(f"{evaluation / 'metrics.json'}: lacks `planning`; evaluate the planner again")
    return ControllerResult(
        algorithm,
        kind,
        int(seed.removeprefix("seed_")),
        metrics,
        np.loadtxt(require_file(evaluation / "success_rates.csv"), delimiter=",", ndmin=2),
        evaluation,
        _read_curve(training / "curves.csv") if trained else [],
        read_json(training / "meta.json") if trained else planning,
    )


def _read_curve(path: Path) -> list[dict[str, float]]:
    with require_file(path).open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
