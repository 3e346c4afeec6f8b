"""Stage `view`: a log as a file for Foxglove or Rerun: the arm, W+ and what of it is painted, target, commands."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputLogs, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.transports.mcap_file import write_mcap_file
from pipeline.deployment.viewing.coverage import ReachableCells
from pipeline.deployment.viewing.painting import painted_topics
from pipeline.deployment.viewing.ros_messages import STORE
from pipeline.deployment.viewing.visual_topics import visual_topics
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.machine.kinematics import load_arm
from pipeline.tracking import StageRun


@dataclass
class ViewStage(PipelineConfiguration):
    """Keys of `conf/view.yaml`."""

    coverage: CoverageConfig = MISSING
    logs: InputLogs = MISSING
    output: OutputFolder = MISSING


@stage(ViewStage)
def main(configuration: ViewStage, run: StageRun) -> None:
    """Write one MCAP file per log into the folder `output`."""
    machine, output = configuration.machine, Path(configuration.output)
    entries = find_logs(Path(configuration.logs))
    reachable = ReachableCells(machine, load_arm(machine, MACHINE_DIRECTORY), configuration.coverage)
    for entry in entries:
        log = read_log(entry, machine)
        if not len(log.q):
            raise InputError(f"{entry.path}: no joint states of {machine.name}, so there is nothing to see")
        path = output / f"{entry.name}.mcap"
        topics = visual_topics(log, read_graph_topics(entry), machine, MACHINE_DIRECTORY)
        write_mcap_file(path, STORE, [*topics, *painted_topics(log, reachable)])
        print(f"view: {path}")
    run.artifact(output, "view")


if __name__ == "__main__":
    main()
