"""Stage `view`: a log as a file for Foxglove or Rerun: the arm, W+, target, commands, what the graph said."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.paths import InputLogs, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.deployment.transports.mcap_file import write_mcap_file
from pipeline.deployment.viewing.visual_topics import STORE, visual_topics
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.tracking import StageRun


@dataclass
class ViewStage(PipelineConfiguration):
    """Keys of `conf/view.yaml`."""

    logs: InputLogs = MISSING
    output: OutputFolder = MISSING


@stage(ViewStage)
def main(configuration: ViewStage, run: StageRun) -> None:
    """Write one MCAP file per log into the folder `output`."""
    machine, output = configuration.machine, Path(configuration.output)
    entries = find_logs(Path(configuration.logs))
    for entry in entries:
        log = read_log(entry, machine)
        if not len(log.q):
            raise InputError(f"{entry.path}: no joint states of {machine.name}, so there is nothing to see")
        path = output / f"{entry.name}.mcap"
        write_mcap_file(path, STORE, visual_topics(log, read_graph_topics(entry), machine, MACHINE_DIRECTORY))
        print(f"view: {path}")
    run.artifact(output, "view")


if __name__ == "__main__":
    main()
