"""Stage `report`: what was learnt and how well it works, as one self-contained page and as tables under git."""

from dataclasses import dataclass
from pathlib import Path

import yaml
from omegaconf import MISSING

from pipeline.configuration import MACHINE_DIRECTORY, PipelineConfiguration, stage
from pipeline.logs.tuples import read_tuples
from pipeline.machine.kinematics import load_arm
from pipeline.machine.offscreen import RenderingUnavailableError
from pipeline.reporting.closed_loop_chapter import closed_loop_section, closed_loop_table
from pipeline.reporting.episode import episode_film
from pipeline.reporting.page import Section, render_page
from pipeline.reporting.results import read_results
from pipeline.reporting.summary import (
    OWN,
    SIMULATED,
    brax_evaluation_table,
    controller_section,
    data_section,
    error_table,
    evaluated,
    judgement_section,
    key_figures,
    model_section,
    selected_models_table,
    verdict,
)
from pipeline.reporting.tables import Table
from pipeline.tracking import StageRun, dvc_hashes, flatten_metrics

RECORDED = "data/raw/sessions"  # where the stage record puts its logs
EPISODE = 0  # of the evaluation
DATA = [
    "data/raw/sessions",
    "data/raw/held_out",
    "data/raw/changed/sessions",
    "data/processed/sessions",
    "data/processed/held_out",
]
FRAMES_PER_SECOND = 10


@dataclass
class ReportStage(PipelineConfiguration):
    """Keys of `conf/report.yaml`."""

    cells: str = MISSING
    sessions: str = MISSING
    artifacts: str = MISSING
    output: str = MISSING


@stage(ReportStage)
def main(configuration: ReportStage, run: StageRun) -> None:
    """Gather what the stages left, lay out the page, write the tables, and sum up the pipeline's run."""
    machine, output = configuration.machine, Path(configuration.output)
    arm = load_arm(machine, MACHINE_DIRECTORY) if machine.arm is not None else None
    cells = yaml.safe_load(Path(configuration.cells).read_text(encoding="utf-8"))
    kinds = [f"{model}_{target}" for model in cells["models"] for target in cells["targets"]]
    results = read_results(Path(configuration.artifacts), kinds, cells["seeds"])
    origin = SIMULATED if cells["logs"] == RECORDED else OWN
    sections = [
        data_section(machine, arm, read_tuples(Path(configuration.sessions), machine)),
        model_section(machine, results.models, origin),
        *map(judgement_section, results.judgements),
        closed_loop_section(machine, results.closed_loop, output),
    ]
    tables = {"selected_models": selected_models_table(results.models, origin)}
    tables |= {f"prediction_error_{model.kind}": error_table(machine, model) for model in results.models}
    if results.controllers:
        sections.append(controller_section(results, origin))
        sections.append(episode_section(configuration, results.controllers[0].evaluation))
        tables["brax_evaluation"] = brax_evaluation_table(results, origin)
    if (closed_loop := closed_loop_table(machine, results.closed_loop)) is not None:
        tables["closed_loop"] = closed_loop
    page = render_page(
        f"Reaching with {machine.name}: from teleoperation logs to a policy",
        verdict(results, configuration.profile),
        key_figures(machine, results),
        sections,
        provenance(configuration, run),
    )
    write(output, page, tables)
    summary = {
        f"identify.{model.kind}.{key}": value
        for model in results.models
        for key, value in flatten_metrics(model.metrics).items()
    }
    for kind in {controller.kind for controller in results.controllers}:
        summary |= {
            f"ppo.{kind}.{key}": value for key, value in evaluated(results.controllers_of(kind)).items()
        }
    summary |= {
        f"close_loop.{key}": value
        for key, value in flatten_metrics({"error": results.closed_loop.document.get("error", {})}).items()
    }
    run.metrics(summary)
    run.parent_metrics(summary, {f"dvc.{path}": digest for path, digest in dvc_hashes(DATA).items()})
    run.artifact(output, "report")


def episode_section(configuration: ReportStage, evaluation: Path) -> Section:
    """An episode to look at, where this computer can render."""
    title = "What it looks like"
    try:
        film = episode_film(configuration.machine, MACHINE_DIRECTORY, evaluation, EPISODE, FRAMES_PER_SECOND)
    except RenderingUnavailableError as error:
        return Section(title, f"No picture: {error}")
    return Section(title, "The first evaluation episode of the first policy, on the learned model.", [film])


def provenance(configuration: ReportStage, run: StageRun) -> list[tuple[str, str]]:
    """Name and value of what the figures were made from."""
    hashes = dvc_hashes(DATA)
    return [
        ("profile", f"{configuration.profile} (conf/profile/{configuration.profile}.yaml)"),
        ("machine", f"{configuration.machine.name} (conf/machine/{configuration.machine.name}.yaml)"),
        *((f"{path} (DVC)", digest) for path, digest in hashes.items()),
        ("MLflow run", run.parent_id or run.run_id or "not tracked"),
        ("made by", "make repro"),
    ]


def write(output: Path, page: str, tables: dict[str, Table]) -> None:
    """Write the page, and each table as Markdown, LaTeX and JSON."""
    (output / "tables").mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        (output / "tables" / f"{name}.md").write_text(table.markdown(), encoding="utf-8")
        (output / "tables" / f"{name}.tex").write_text(table.latex(), encoding="utf-8")
        (output / "tables" / f"{name}.json").write_text(table.json(), encoding="utf-8")
    (output / "index.html").write_text(page, encoding="utf-8")
    print(f"report: open {output / 'index.html'}")


if __name__ == "__main__":
    main()
