"""Stage `run_graph`: the graph as ROS 1 nodes at wall-clock time, the learned model in the machine's place."""

import json
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.stage import stage
from pipeline.deployment.components.goals import known_configurations
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.drivers.machine import LearnedMachine, Machine
from pipeline.deployment.messages import ReachResult
from pipeline.deployment.successive import run_successive
from pipeline.deployment.transports.ros1.agreement import agreement_table, paired_differences
from pipeline.deployment.transports.ros1.launch import graph, require_running
from pipeline.files.atomic import write_whole
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.trajectories import load_logs
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.logged_trials import logged_trials, reaching_summary
from pipeline.stages.graph_node import (
    LOGS,
    Driver,
    GraphStage,
    fixed_episodes,
    node_commands,
    operate,
    plant,
    refuse_others_logs,
    write_bag_of,
    write_run,
)
from pipeline.stages.processes.overrides import of_this_job
from pipeline.stages.processes.own_process import for_this_job
from pipeline.stages.sim2sim import controller_delays, graph_parts
from pipeline.tracking import StageRun

FOLDERS = (LOGS, "simulated")


@dataclass
class RunGraphStage(GraphStage):
    """Keys of `conf/run_graph.yaml`."""

    ingest: IngestConfig = MISSING


@stage(RunGraphStage)
def main(configuration: RunGraphStage, run: StageRun) -> None:
    """Launch the graph and give it its targets; write how they ended, bags of it and of simulated time, and compare."""
    output = Path(configuration.output)
    refuse_others_logs(output, FOLDERS)
    results, recorder = for_this_job(run_targets, configuration, of_this_job(configuration))
    write_run(configuration, results, recorder)
    write_bag_of(simulate(configuration), output / "simulated", configuration.machine)
    real, simulated = (trials_of(output / folder, configuration) for folder in FOLDERS)
    if not real or len(real) != len(simulated):
        print(f"{len(real)} trials on the real graph, {len(simulated)} in simulated time: not compared")
        return
    differences = paired_differences(real, simulated)
    content = {name: row._asdict() for name, row in differences.items()}
    (output / "agreement.json").write_text(json.dumps(content, indent=1) + "\n")
    table = agreement_table(differences)
    write_whole(output / "agreement.md", table.encode())
    print(table, end="")


def trials_of(folder: Path, configuration: RunGraphStage) -> list[dict[str, Any]]:
    """Metrics of each trial in a bag, as `evaluate_logs` has them."""
    machine = configuration.machine
    trials = [
        trial
        for log in load_logs(folder, machine, configuration.ingest, configuration.control.loop_tracker)
        if log.targets is not None
        for trial in logged_trials(log.trajectories, log.targets, configuration.episodes.steps)
    ]
    if not trials:
        return []
    summary: list[dict[str, Any]] = reaching_summary(trials, machine, load_arm(machine, MACHINE_DIRECTORY))[
        "trials"
    ]
    return summary


def run_targets(configuration: GraphStage, overrides: list[str]) -> tuple[list[ReachResult], Recorder]:
    """Launch the nodes with the overrides of this command, pursue the targets, shut the nodes down."""
    nodes = node_commands(configuration, overrides)
    folder = Path(configuration.output) / "nodes"
    with graph(nodes, folder) as processes:
        return operate(configuration, partial(require_running, processes, folder))


def simulate(configuration: GraphStage) -> Recorder:
    """The same targets from the same start through the graph in simulated time: what the real one is held against."""
    episodes = fixed_episodes(configuration)
    parts = graph_parts(configuration, configuration.machine)
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    machine: Machine = LearnedMachine(parts.step, episodes.starts[0])
    estimator = None
    if configuration.driver is Driver.plant:
        machine, estimator = plant(configuration)
    return run_successive(
        parts, controller_delays(configuration), machine, estimator, episodes.targets, time.time_ns()
    )


if __name__ == "__main__":
    main()
