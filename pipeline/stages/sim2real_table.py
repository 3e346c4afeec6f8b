"""Stage `sim2real_table`: Sim2Real of the controllers in a folder of artifacts, as the report's table of it alone."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.reporting.results.deployments import files_of, read_deployments
from pipeline.reporting.results.paper import SIMULATED
from pipeline.reporting.tables.deployment import sim2real_table
from pipeline.tracking import StageRun


@dataclass
class Sim2RealTableStage(PipelineConfiguration):
    """Keys of `conf/sim2real_table.yaml`."""

    artifacts: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(Sim2RealTableStage)
def main(configuration: Sim2RealTableStage, run: StageRun) -> None:
    """Write the table, as JSON, Markdown and LaTeX."""
    artifacts, output = Path(configuration.artifacts), Path(configuration.output)
    deployments = read_deployments(artifacts, [])
    table = sim2real_table(deployments, SIMULATED)
    if table is None:
        raise InputError(
            f"artifacts={artifacts}: no controller drove the machine; run sim2sim and sim2real first"
        )
    run.inputs(*files_of(artifacts, [], deployments))
    table.write(output, "sim2real")
    print(table.markdown())
    run.artifact(output, "sim2real")


if __name__ == "__main__":
    main()
