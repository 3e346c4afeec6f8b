"""Stage `measure_delays`: how late messages, decisions and ticks are on the real graph; what `sim2sim` draws from."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import MISSING

from pipeline.configuration.paths import OutputFile
from pipeline.configuration.stage import stage
from pipeline.control.icem.variant import RewardVariant
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.transports.ros1.measurements import (
    Measured,
    distributions,
    load_measured,
    real_time_table,
)
from pipeline.deployment.transports.simulated_time.delays import save_delays
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.stages.graph_node import GraphStage
from pipeline.stages.processes.overrides import of_this_job, replaced
from pipeline.stages.processes.own_process import in_own_process
from pipeline.stages.run_graph import run_targets
from pipeline.stages.sim2sim import planner_effort
from pipeline.tracking import StageRun

REPLACED = ("policy", "variant", "output")  # overrides that each run has of its own


@dataclass
class MeasureDelaysStage(GraphStage):
    """Keys of `conf/measure_delays.yaml`."""

    planner: RewardVariant | None = None
    delays: OutputFile = MISSING


@stage(MeasureDelaysStage)
def main(configuration: MeasureDelaysStage, run: StageRun) -> None:
    """Run the graph over the targets, with the policy and with the planner; write delays and the real-time table."""
    if configuration.kind is not ControllerKind.ppo:
        raise InputError(
            "policy is not named; the links are measured with a policy, a planner's decisions with planner"
        )
    output = Path(configuration.output)
    load_before = os.getloadavg()[0]
    runs = {"PPO": measured_run(replace(configuration, output=str(output / "ppo")))}
    if configuration.planner is not None:
        planning = replace(
            configuration, policy=None, variant=configuration.planner, output=str(output / "icem")
        )
        runs["iCEM"] = measured_run(planning)
    how: dict[str, Any] = {
        "command": "measure_delays",
        "targets": configuration.targets,
        "controllers": list(runs),
        "cores": len(os.sched_getaffinity(0)),
        "load_average_before": round(load_before, 2),
        "load_average_after": round(os.getloadavg()[0], 2),
    }
    if configuration.planner is not None:
        how["planner"] = planner_effort(configuration)._asdict()
    save_delays(Path(configuration.delays), distributions(runs["PPO"], runs.get("iCEM")), how)
    decision_s = configuration.control.action_repeats * configuration.machine.dt_s
    table = real_time_table(runs, decision_s)
    write_whole(output / "real_time.md", table.encode())
    print(table, end="")


def measured_run(configuration: MeasureDelaysStage) -> Measured:
    """Run the graph with one controller; what its nodes measured."""
    overrides = replaced(of_this_job(configuration), {key: getattr(configuration, key) for key in REPLACED})
    in_own_process(drive, configuration, overrides)
    return load_measured(Path(configuration.output) / "nodes")


def drive(configuration: MeasureDelaysStage, overrides: list[str]) -> None:
    """Run the graph over the targets; all that is wanted of it are the files that its nodes write."""
    run_targets(configuration, overrides)


if __name__ == "__main__":
    main()
