"""Stage `measure_delays`: how late messages, decisions and ticks are on the real graph; what `sim2sim` draws from."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import GraphKeys, node_commands, settings_of
from pipeline.configuration.overrides import of_this_job, replaced
from pipeline.configuration.own_process import in_own_process
from pipeline.configuration.paths import OutputFile
from pipeline.configuration.stage import stage
from pipeline.control.icem.variant import RewardVariant
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.compose import planner_effort
from pipeline.deployment.nodes import NodeSettings
from pipeline.deployment.transports.ros1.measurements import Measured, load_measured, write_measurements
from pipeline.errors import InputError
from pipeline.testbench.target_run import run_targets
from pipeline.tracking import StageRun

UNSUPERVISED = (
    "deployment.supervisor.rules=[]",
    "deployment.interface.supervised=false",
)  # as in this stage's file
REPLACED = ("policy", "variant", "output")  # overrides that each run has of its own


@dataclass
class MeasureDelaysStage(GraphKeys):
    """Keys of `conf/measure_delays.yaml`."""

    planner: RewardVariant | None = None
    delays: OutputFile = MISSING


@stage(MeasureDelaysStage)
def main(configuration: MeasureDelaysStage, run: StageRun) -> None:
    """Run the graph over the targets, with the policy and with the planner; write delays and the real-time table."""
    settings, planner = settings_of(NodeSettings, configuration), configuration.planner
    if settings.kind is not ControllerKind.ppo:
        raise InputError(
            "policy is not named; the links are measured with a policy, a planner's decisions with planner"
        )
    output = Path(configuration.output)
    load_before = os.getloadavg()[0]
    runs = {"PPO": measured_run(replace(configuration, output=str(output / "ppo")))}
    if planner is not None:
        planning = replace(configuration, policy=None, variant=planner, output=str(output / "icem"))
        runs["iCEM"] = measured_run(planning)
    effort = planner_effort(settings) if planner is not None else None
    decision_s = settings.action_repeats * settings.machine.dt_s
    table = write_measurements(
        Path(configuration.delays), output, runs, configuration.targets, effort, decision_s, load_before
    )
    print(table, end="")


def measured_run(configuration: MeasureDelaysStage) -> Measured:
    """Run the graph with one controller; what its nodes measured."""
    overrides = replaced(of_this_job(configuration), {key: getattr(configuration, key) for key in REPLACED})
    commands = node_commands(configuration.driver, [*UNSUPERVISED, *overrides])
    output = Path(configuration.output)
    in_own_process(run_targets, settings_of(NodeSettings, configuration), commands, output)
    return load_measured(output / "nodes")


if __name__ == "__main__":
    main()
