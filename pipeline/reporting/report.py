"""The complete report: its page, its tables, and a summary of the pipeline run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.chapters.closed_loop import closed_loop_section, closed_loop_table
from pipeline.reporting.chapters.controllers import controller_section, evaluated, film_section
from pipeline.reporting.chapters.data import data_section
from pipeline.reporting.chapters.deployment import FIGURES, deployment_section, deployment_tables
from pipeline.reporting.chapters.models import (
    error_table,
    judgement_section,
    model_section,
    selected_models_table,
)
from pipeline.reporting.chapters.overview import key_figures, overview_section, verdict
from pipeline.reporting.chapters.repair import repair_table
from pipeline.reporting.page import render_page
from pipeline.reporting.pictures import Pictures
from pipeline.reporting.results.artifacts import PipelineResults
from pipeline.reporting.results.controllers import by_controller
from pipeline.reporting.results.paper import DEPLOYMENT_COLUMNS, SIMULATED
from pipeline.reporting.table import Table
from pipeline.reporting.tables.evaluation import brax_evaluation_table, comparison_table


@dataclass(frozen=True)
class Report:
    """Result of `build_report`.

    Attributes:
        page: HTML, self-contained except for the link to the closed loop's report.
        tables: tables by name.
        summary: figures of the whole pipeline, by `<stage>.<cell>.<name>`; nested as the stages wrote them.
    """

    page: str
    tables: dict[str, Table]
    summary: dict[str, object]


def build_report(
    machine: MachineSpecification,
    machine_directory: Path,
    trajectories: Sequence[Trajectory],
    results: PipelineResults,
    pictures: Pictures,
    origin: str,
    profile: str,
    output: Path,
    provenance: Sequence[tuple[str, str]],
) -> Report:
    """Lay out the chapters.

    Args:
        machine_directory: folder `conf/machine`, with its kinematics where they are described.
        trajectories: the training data.
        results: outputs of the stages.
        pictures: pictures of the controllers.
        origin: whose machine it is, `paper.SIMULATED` or `paper.OWN`.
        profile: name of the profile.
        output: folder of the page; links are relative to it.
        provenance: names and values, such as commit and data hashes.
    """
    arm = load_arm(machine, machine_directory) if machine.arm is not None else None
    data = data_section(machine, arm, trajectories)
    closed_loop = closed_loop_section(machine, results.closed_loop, output)
    sections = [overview_section(machine, results, data, closed_loop, origin)]
    if results.controllers:
        sections.append(film_section(pictures.films, pictures.unavailable))
        figures = {name: figure for name, figure in pictures.figures.items() if name not in FIGURES}
        sections.append(controller_section(results.controllers, figures, origin))
    if results.deployments:
        in_field = results.in_field if origin == SIMULATED else None
        sections.append(deployment_section(machine, results.deployments, pictures.figures, origin, in_field))
    sections.append(model_section(machine, results.models, origin))
    sections += [*map(judgement_section, results.judgements), data, closed_loop]
    page = render_page(
        f"Reaching with {machine.name}: from teleoperation logs to a controller",
        verdict(results, profile),
        key_figures(machine, results),
        sections,
        provenance,
    )
    return Report(page, _tables(machine, results, origin), _summary(results))


def write_report(report: Report, output: Path) -> None:
    """Write the page, and each table as Markdown, LaTeX and JSON."""
    for name, table in report.tables.items():
        table.write(output / "tables", name)
    (output / "index.html").write_text(report.page, encoding="utf-8")


def _tables(machine: MachineSpecification, results: PipelineResults, origin: str) -> dict[str, Table]:
    tables = {"selected_models": selected_models_table(results.models, origin)}
    tables |= {f"prediction_error_{model.kind}": error_table(machine, model) for model in results.models}
    if results.controllers:
        tables["brax_evaluation"] = brax_evaluation_table(results.controllers, origin)
        tables["brax_evaluation_beside_paper"] = comparison_table(results.controllers, origin)
    for name, table in deployment_tables(machine, results.deployments, origin).items():
        tables[name if name in ("sim2sim", "sim2real") else f"deployment_{name}"] = table
    if (closed_loop := closed_loop_table(machine, results.closed_loop)) is not None:
        tables["closed_loop"] = closed_loop
    if (repaired := repair_table(results.closed_loop.repair or {})) is not None:
        tables["repair"] = repaired
    return tables


def _summary(results: PipelineResults) -> dict[str, object]:
    summary: dict[str, object] = {f"identify.{model.kind}": model.metrics for model in results.models}
    for group in by_controller(results.controllers).values():
        summary[f"{group[0].algorithm}.{group[0].kind}"] = evaluated(group)
    for deployment in results.deployments:
        for transfer, drives in (("sim2sim", deployment.sim2sim), ("sim2real", deployment.sim2real)):
            if drives:  # the last place is the final one of the transfer
                metrics = {key: drives[-1].metrics[key] for key in DEPLOYMENT_COLUMNS}
                summary[f"{transfer}.{deployment.name}"] = metrics
    summary["close_loop.error"] = results.closed_loop.document.get("error", {})
    return summary
