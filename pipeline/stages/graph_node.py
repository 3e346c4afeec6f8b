"""Stage `graph_node`: one node of the ROS 1 graph, a process of its own; started by `run_graph` or by roslaunch."""

import sys
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import GraphKeys, settings_of
from pipeline.configuration.stage import stage
from pipeline.deployment.compose import dispatch_synchronously
from pipeline.deployment.nodes import KNOWN_NODES, OPERATOR, NodeSettings
from pipeline.errors import InputError
from pipeline.testbench.graph_node import build, freeze_loaded
from pipeline.testbench.target_run import LOGS, operate, refuse_others_logs, write_run
from pipeline.tracking import StageRun


@dataclass
class GraphNodeStage(GraphKeys):
    """Keys of `conf/graph_node.yaml`."""

    node: str = MISSING


@stage(GraphNodeStage)
def main(configuration: GraphNodeStage, run: StageRun) -> None:
    """Be one node until the graph is shut down; or the operator, until all targets have been pursued."""
    name, output = configuration.node, Path(configuration.output)
    if name not in KNOWN_NODES:
        raise InputError(f"node={name}: no such node; known are {', '.join(KNOWN_NODES)}")
    dispatch_synchronously()
    settings = settings_of(NodeSettings, configuration)
    if name == OPERATOR:
        refuse_others_logs(output, [LOGS])
        write_run(output, settings.machine, *operate(settings, output))
        return
    node = build(settings, name)
    taken_ms = 1e3 * freeze_loaded()
    print(f"{name}: {taken_ms:.0f} ms for a full collection of garbage, the last one", flush=True)
    node.spin()
    node.save(output / "nodes" / f"{name}.json")


if __name__ == "__main__":
    sys.argv = [word for word in sys.argv if ":=" not in word]  # roslaunch's; the node takes them by itself
    main()
