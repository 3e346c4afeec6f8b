"""Stage `ingest`: bags become tuples of configuration, velocity and command at the machine's rate."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.pages import write_page
from pipeline.configuration.paths import OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.logs.ingest import ingest, write_metrics
from pipeline.logs.ingest_config import IngestConfig
from pipeline.tracking import StageRun, flatten_metrics


@dataclass
class IngestStage(PipelineConfiguration):
    """Keys of `conf/ingest.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    logs: str = MISSING  # not checked: the output may lie among the logs, see pipeline.logs.ingest
    output: OutputFolder = MISSING
    report: OutputFolder = MISSING
    allow_empty: bool = False
    page: bool = True


@stage(IngestStage)
def main(configuration: IngestStage, run: StageRun) -> None:
    """Read every log, write tuples and the quality report; logs that fail are named at the end."""
    run.inputs(configuration.logs)
    summary = ingest(
        configuration.machine,
        Path(configuration.logs),
        Path(configuration.output),
        configuration.ingest,
        configuration.control.loop_tracker,
        allow_empty=configuration.allow_empty,
    )
    report_directory = Path(configuration.report)
    write_metrics(summary, report_directory / "quality.json")
    has_page = configuration.page or bool(summary.failures)  # the page alone tells which logs failed
    if has_page:
        tuples = Path(configuration.output)
        write_page("quality", configuration.machine, MACHINE_DIRECTORY, summary, tuples, report_directory)
    for report in summary.reports:
        print(report.line)
        for text in (*(f"warning: {warning}" for warning in report.warnings), *report.findings):
            print(f"  {text}")
    run.metrics(flatten_metrics({key: value for key, value in summary.metrics().items() if "/" not in key}))
    for name in ("quality.json", *(["quality.html"] if has_page else [])):
        run.artifact(report_directory / name)
    summary.raise_if_failed()


if __name__ == "__main__":
    main()
