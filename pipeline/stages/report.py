"""Stage `report`: what was learnt and how well it works, as one self-contained page and as tables under git."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputLogs, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.logs.tuples import read_tuples
from pipeline.reporting.pictures import load_pictures
from pipeline.reporting.report import build_report, write_report
from pipeline.reporting.results.artifacts import files_read, read_results
from pipeline.reporting.results.cells import read_controller_cells
from pipeline.reporting.results.controllers import controllers_of
from pipeline.reporting.results.paper import origin_of
from pipeline.tracking import StageRun, flatten_metrics
from pipeline.tracking.provenance import data_tags, provenance


@dataclass
class ReportStage(PipelineConfiguration):
    """Keys of `conf/report.yaml`."""

    cells: InputPath = MISSING
    sessions: InputLogs = MISSING
    artifacts: InputPath = MISSING
    output: OutputFolder = MISSING
    field: InputPath | None = None


@stage(ReportStage)
def main(configuration: ReportStage, run: StageRun) -> None:
    """Gather what the stages left, lay out the page, write the tables, and sum up the pipeline's run."""
    machine, artifacts = configuration.machine, Path(configuration.artifacts)
    output = Path(configuration.output)
    cells = read_controller_cells(Path(configuration.cells), "identified", "logs")
    results = read_results(artifacts, list(cells["identified"]), controllers_of(cells), configuration.field)
    run.inputs(configuration.sessions, *files_read(artifacts, results))
    report = build_report(
        machine,
        MACHINE_DIRECTORY,
        read_tuples(Path(configuration.sessions), machine),
        results,
        load_pictures(artifacts / "pictures"),
        origin_of(cells["logs"]),
        configuration.profile,
        output,
        provenance(configuration.profile, machine.name, run),
    )
    write_report(report, output)
    run.metrics(summary := flatten_metrics(report.summary))
    run.parent_metrics(summary, data_tags())
    run.artifact(output, "report")
    print(f"report: open {output / 'index.html'}")


if __name__ == "__main__":
    main()
