"""Reader of deployments: `artifacts/sim2sim`, `artifacts/sim2real`, `artifacts/evaluate_logs`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.machine.chain import GROUND
from pipeline.reaching.metrics import Traces, load_traces, reaching_metrics, success_rate_matrix
from pipeline.reporting.results.cells import read_controller_cells
from pipeline.reporting.results.controllers import ControllerResult, controllers_of, read_controllers
from pipeline.reporting.results.files import read_json, require_file
from pipeline.reporting.results.paper import DEPLOYED


class Where(StrEnum):
    """Places in which a controller drives; the values are headings of the tables."""

    brax = "Brax"
    graph = "Graph"  # the asynchronous graph in simulated time; the paper uses Gazebo
    plant = "Plant"  # the simulated machine through the same graph; the paper uses the real one


@dataclass(frozen=True)
class Drive:
    """Trials of one controller in one place.

    Attributes:
        name: of the controller, `<algorithm>_<model kind>`.
        where: place of the trials.
        metrics: over the trials; names as in `metrics.json`.
        success_rates: over the paper's grid of thresholds, (17, 8).
        n_trials: number of trials.
    """

    name: str
    where: Where
    metrics: Mapping[str, float]
    success_rates: np.ndarray
    n_trials: int


@dataclass(frozen=True)
class Deployment:
    """All trials of one controller.

    Attributes:
        name: of the controller.
        sim2sim: Brax (if evaluated there) and the graph, over the same episodes.
        sim2real: the graph and the plant, over the same first targets; empty if it did not drive the plant.
        until_goal: content of `goals.json` of the run whose trials end at the goal; None without such a run.
        model_error: 4-second error of its model on the plant's bag by joint, rad or m; empty without a bag.
        delays: delays measured in the plant's bag (`evaluate_logs`); empty without a bag.
        safety: interventions of the safety measures in the bag (`evaluate_logs`).
        plant_bags: folder of the bag of its drive on the plant, each target until its time-out; None without one.
    """

    name: str
    sim2sim: Sequence[Drive]
    sim2real: Sequence[Drive]
    until_goal: dict[str, Any] | None
    model_error: Mapping[str, float]
    delays: Mapping[str, Any]
    safety: Mapping[str, Any]
    plant_bags: Path | None = None


def files_of(
    artifacts: Path, controllers: Sequence[ControllerResult], deployments: Sequence[Deployment]
) -> list[Path]:
    """Existing files from which evaluations and deployments are read."""
    evaluated = [controller.evaluation / "traces.npz" for controller in controllers]
    deployed = [
        path
        for deployment in deployments
        for path in (
            artifacts / "sim2sim" / deployment.name / "traces.npz",
            artifacts / "sim2real" / deployment.name,
        )
    ]
    return [path for path in evaluated + deployed if path.exists()]


def read_evaluated(
    cells: Path, artifacts: Path
) -> tuple[list[ControllerResult], list[Deployment], list[Path]]:
    """Controllers, their deployments, and the files of both.

    Args:
        cells: file of the models and seeds that `dvc repro` makes.
        artifacts: folder of the stages' outputs.

    Raises:
        InputError: a file is missing or damaged.
    """
    controllers = read_controllers(artifacts, controllers_of(read_controller_cells(cells)))
    deployments = read_deployments(artifacts, controllers)
    return controllers, deployments, files_of(artifacts, controllers, deployments)


def read_deployments(artifacts: Path, controllers: Sequence[ControllerResult]) -> list[Deployment]:
    """Read every deployment; those of the paper's tables come first, in its order.

    Metrics without traces are ignored: git keeps them from an earlier run, and the graph no longer makes them.

    Args:
        artifacts: folder of the stages' outputs.
        controllers: controllers evaluated in Brax; the lowest seed of each is deployed.

    Raises:
        InputError: a file is missing or damaged.
    """
    names = sorted(path.parent.name for path in (artifacts / "sim2sim").glob("*/traces.npz"))
    ordered = [name for name in DEPLOYED if name in names] + [name for name in names if name not in DEPLOYED]
    evaluated: dict[str, ControllerResult] = {}
    for controller in sorted(controllers, key=lambda controller: controller.seed):
        evaluated.setdefault(controller.name, controller)
    return [_deployment(artifacts, name, evaluated.get(name)) for name in ordered]


def first_trials(traces: Traces, n: int) -> Traces:
    """The first `n` of the episodes."""
    return Traces(*(values[:n] for values in traces))


def _deployment(artifacts: Path, name: str, evaluated: ControllerResult | None) -> Deployment:
    graph = load_traces(require_file(artifacts / "sim2sim" / name / "traces.npz"))
    n_episodes = len(graph.q)
    sim2sim = [_drive(name, Where.graph, graph)]
    if evaluated is not None:
        brax = load_traces(require_file(evaluated.evaluation / "traces.npz"))
        if len(brax.q) >= n_episodes:
            sim2sim.insert(0, _drive(name, Where.brax, first_trials(brax, n_episodes)))
    path = artifacts / "evaluate_logs" / name / "time_out.json"
    content = read_json(path) if path.exists() else {}
    if "reaching" not in content:  # not driven, or a note that the machine lacks a plant
        return Deployment(name, sim2sim, (), None, {}, {}, {})
    driven = artifacts / "sim2real" / name
    reaching, goals, bags = content["reaching"], driven / "goal/goals.json", driven / "time_out/logs"
    matrix = np.array(reaching["success_rates"]["matrix"])
    n_targets = int(reaching["n_episodes"])
    plant = Drive(name, Where.plant, reaching, matrix, n_targets)
    return Deployment(
        name,
        sim2sim,
        (_drive(name, Where.graph, first_trials(graph, n_targets)), plant),
        read_json(goals) if goals.exists() else None,
        content["open_loop_rmse_80"],
        content.get("delays", {}),
        content.get("safety", {}),
        bags if bags.exists() else None,
    )


def _drive(name: str, where: Where, traces: Traces) -> Drive:
    metrics = reaching_metrics(traces, GROUND).as_dict()  # no table has its contacts
    return Drive(name, where, metrics, success_rate_matrix(traces), len(traces.q))
