"""Stage `run_graph`: the graph as ROS 1 nodes at wall-clock time, the learned model in the machine's place."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from pipeline.configuration import stage
from pipeline.deployment.goals import known_configurations
from pipeline.deployment.machine import LearnedMachine
from pipeline.deployment.messages import ReachResult
from pipeline.deployment.recording import Recorder
from pipeline.deployment.ros1.launch import graph
from pipeline.deployment.successive import run_successive
from pipeline.stages.graph_node import (
    GraphStage,
    fixed_episodes,
    node_commands,
    operate,
    write_bag_of,
    write_run,
)
from pipeline.stages.sim2sim import controller_delays, policy_parts
from pipeline.tracking import StageRun


@dataclass
class RunGraphStage(GraphStage):
    """Keys of `conf/run_graph.yaml`."""


@stage(RunGraphStage)
def main(configuration: RunGraphStage, run: StageRun) -> None:
    """Launch the graph and give it its targets; write how they ended and bags of it and of simulated time."""
    results, recorder = run_targets(configuration, sys.argv[1:])
    write_run(configuration, results, recorder)
    write_bag_of(simulate(configuration), Path(configuration.output) / "simulated", configuration.machine)


def run_targets(configuration: GraphStage, overrides: list[str]) -> tuple[list[ReachResult], Recorder]:
    """Launch the nodes with the overrides of this command, pursue the targets, shut the nodes down."""
    nodes = node_commands(configuration, overrides)
    with graph(nodes, Path(configuration.output) / "nodes") as processes:
        return operate(configuration, lambda: all(process.poll() is None for process in processes.values()))


def simulate(configuration: GraphStage) -> Recorder:
    """The same targets from the same start through the graph in simulated time: what the real one is held against."""
    episodes = fixed_episodes(configuration)
    parts = policy_parts(configuration, configuration.machine)
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    machine = LearnedMachine(parts.step, episodes.starts[0])
    return run_successive(
        parts, controller_delays(configuration), machine, None, episodes.targets, time.time_ns()
    )


if __name__ == "__main__":
    main()
