"""Stage `run_graph`: the graph as ROS 1 nodes at wall-clock time, the learned model in the machine's place."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.configuration.graph import GraphKeys, node_commands, settings_of
from pipeline.configuration.overrides import of_this_job
from pipeline.configuration.own_process import for_this_job
from pipeline.configuration.stage import stage
from pipeline.deployment.nodes import NodeSettings
from pipeline.deployment.transports.ros1.agreement import write_agreement
from pipeline.testbench.target_run import (
    LOGS,
    SIMULATED,
    refuse_others_logs,
    run_targets,
    simulate_targets,
    trials_of,
    write_bag_of,
    write_run,
)
from pipeline.tracking import StageRun


@dataclass
class RunGraphStage(GraphKeys):
    """Keys of `conf/run_graph.yaml`."""


@stage(RunGraphStage)
def main(configuration: RunGraphStage, run: StageRun) -> None:
    """Launch the graph and give it its targets; write how they ended, bags of it and of simulated time, and compare."""
    output, settings = Path(configuration.output), settings_of(NodeSettings, configuration)
    refuse_others_logs(output, (LOGS, SIMULATED))
    commands = node_commands(configuration, of_this_job(configuration))
    write_run(output, settings.machine, *for_this_job(run_targets, settings, commands, output))
    write_bag_of(simulate_targets(settings), output / SIMULATED, settings.machine)
    real, simulated = (
        trials_of(output / folder, settings, configuration.ingest) for folder in (LOGS, SIMULATED)
    )
    if not real or len(real) != len(simulated):
        print(f"{len(real)} trials on the real graph, {len(simulated)} in simulated time: not compared")
        return
    print(write_agreement(output, real, simulated), end="")


if __name__ == "__main__":
    main()
