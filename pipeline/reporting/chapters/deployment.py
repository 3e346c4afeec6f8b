"""The report's chapter on deployment: the controllers in the graph with delays, and on the plant."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.metrics import PITCH_THRESHOLDS_RAD, POSITION_THRESHOLDS_M
from pipeline.reporting.chapters.models import worst_joint
from pipeline.reporting.figures.arrays import success_rate_figure
from pipeline.reporting.page import SVG, Figure, Points, Section
from pipeline.reporting.results.controllers import controller_title
from pipeline.reporting.results.deployments import Deployment, Drive
from pipeline.reporting.table import Table
from pipeline.reporting.tables.deployment import (
    delays_table,
    sim2real_table,
    sim2sim_table,
    success_rate_changes,
    table_in_field,
    until_goal_table,
)

TITLE = "Deployment"
SIM2SIM_RATES, SIM2REAL_RATES = "sim2sim_success_rates", "sim2real_success_rates"
POSE_SEQUENCE = "pose_sequence"
FIGURES = (SIM2SIM_RATES, SIM2REAL_RATES, POSE_SEQUENCE)  # names of the chapter's pictures


def deployment_section(
    machine: MachineSpecification,
    deployments: Sequence[Deployment],
    figures: Mapping[str, Figure],
    origin: str,
    in_field: Mapping[str, Any] | None = None,
) -> Section:
    """Change of success rates through delays and through transfer to the plant, and to that in the field."""
    tables = deployment_tables(machine, deployments, origin)
    delays = tables.pop("delays", None)
    if in_field is not None:
        tables["in_field"] = table_in_field(in_field)
    return Section(
        TITLE,
        "The controllers drive the learned model, then the simulated machine (plant), through the delayed graph.",
        [figures[name] for name in FIGURES if name in figures],
        list(tables.values()),
        paragraphs=_paragraphs(machine, deployments),
        points=[Points("What the transfer costs", success_rate_changes(deployments))],
        folded_tables=[delays] if delays is not None else [],
    )


def deployment_tables(
    machine: MachineSpecification, deployments: Sequence[Deployment], origin: str
) -> dict[str, Table]:
    """The chapter's available tables, by name."""
    tables = {
        "sim2sim": sim2sim_table(deployments, origin),
        "sim2real": sim2real_table(deployments, origin),
        "until_goal": until_goal_table(machine, deployments),
        "delays": delays_table(deployments),
    }
    return {name: table for name, table in tables.items() if table is not None}


def deployment_figures(deployments: Sequence[Deployment]) -> dict[str, Figure]:
    """Success-rate matrices, side by side as in the paper's figures; by name."""
    sides: dict[str, tuple[str, Callable[[Deployment], Sequence[Drive]]]] = {
        SIM2SIM_RATES: ("Sim2Sim: success rates in Brax and in the graph", lambda d: d.sim2sim),
        SIM2REAL_RATES: ("Sim2Real: success rates in the graph and on the plant", lambda d: d.sim2real),
    }
    figures = {}
    for name, (title, drives_of) in sides.items():
        rates = {
            f"{controller_title(drive.name)}, {drive.where.lower()} ({drive.n_trials})": drive.success_rates
            for deployment in deployments
            for drive in drives_of(deployment)
        }
        if rates:
            figures[name] = Figure(
                title,
                "Percentage of trials in which distance and pitch error were below their thresholds at the same tick; "
                "number of trials in brackets.",
                success_rate_figure(rates, np.array(POSITION_THRESHOLDS_M), np.array(PITCH_THRESHOLDS_RAD)),
                SVG,
            )
    return figures


def _paragraphs(machine: MachineSpecification, deployments: Sequence[Deployment]) -> list[str]:
    paragraphs = []
    for deployment in deployments:
        if not deployment.model_error:
            continue
        joint, unit = worst_joint(machine, deployment.model_error)
        stops = deployment.safety.get("emergency_stops", 0)
        paragraphs.append(
            f"{controller_title(deployment.name)} on the plant: over four seconds of its drive the model's worst "
            f"joint relative to its range ({joint}) is off by {deployment.model_error[joint]:.3f} {unit}; "
            f"emergency stops: {stops}."
        )
    return paragraphs
