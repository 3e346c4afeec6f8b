"""How late messages, decisions and ticks are on the real graph, measured with a policy and with a planner."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pipeline.control.icem.variant import RewardVariant
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.compose import planner_effort
from pipeline.deployment.nodes import NodeSettings
from pipeline.deployment.transports.own_process import in_own_process
from pipeline.deployment.transports.ros1.measurements import load_measured, write_measurements
from pipeline.errors import InputError
from pipeline.testbench.target_run import run_targets

Commands = Callable[[NodeSettings, Path], Mapping[str, Sequence[str]]]


def measure_delays(
    settings: NodeSettings, planner: RewardVariant | None, commands: Commands, output: Path, delays: Path
) -> str:
    """Run the graph over the targets, with the policy and with the planner; write the file of delays.

    Args:
        settings: Of the graph with the policy.
        planner: Reward that iCEM plans with in a second run; None: there is none.
        commands: The nodes' commands, from settings and the folder that the nodes write to.
        output: Parent of both runs' folders.

    Returns:
        The real-time table.

    Raises:
        InputError: No policy is named, or a node ended early.
    """
    if settings.kind is not ControllerKind.ppo:
        raise InputError(
            "policy is not named; the links are measured with a policy, a planner's decisions with planner"
        )
    load_before = os.getloadavg()[0]
    controllers = {"PPO": settings}
    if planner is not None:
        controllers["iCEM"] = replace(settings, policy=None, variant=planner)
    runs = {}
    for name, controller in controllers.items():
        folder = output / name.lower()
        in_own_process(run_targets, controller, commands(controller, folder), folder)
        runs[name] = load_measured(folder / "nodes")
    effort = planner_effort(settings) if planner is not None else None
    decision_s = settings.action_repeats * settings.machine.dt_s
    return write_measurements(delays, output, runs, settings.targets, effort, decision_s, load_before)
