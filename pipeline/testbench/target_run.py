"""Targets pursued on the ROS 1 graph at wall-clock time, and the same ones in simulated time to compare with."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from pipeline.control.repair.logged_comparison import trials_in
from pipeline.deployment.components.goals import known_configurations
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.compose import controller_delays, graph_parts
from pipeline.deployment.drivers.machine import LearnedMachine, Machine
from pipeline.deployment.messages import ReachGoal, ReachResult
from pipeline.deployment.nodes import Driver, NodeSettings
from pipeline.deployment.successive import run_successive
from pipeline.deployment.transports.ros1.launch import graph, require_running
from pipeline.deployment.transports.ros1.operator import Operator
from pipeline.deployment.transports.unfinished_bag import UnfinishedBag, unfinished
from pipeline.deployment.viewing.live_view import live_view
from pipeline.files.atomic import write_json
from pipeline.logs.formats.recorded_folders import refuse_foreign
from pipeline.logs.ingest_config import IngestConfig
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.logged_trials import reaching_summary
from pipeline.testbench.graph_node import plant

START_TIMEOUT_S = 300.0  # until all nodes have compiled what they run
GOAL_MARGIN_S = 15.0  # beyond the time-out of a goal, before it counts as lost
SETTLE_S = 1.0  # for connections between nodes
RESULTS, LOGS, SIMULATED, BAG = (
    "results.json",
    "logs",
    "simulated",
    "targets",
)  # what a run over targets writes


def run_targets(
    settings: NodeSettings, nodes: Mapping[str, Sequence[str]], output: Path
) -> tuple[list[ReachResult], Recorder]:
    """Launch the nodes by their commands, pursue the targets, shut the nodes down."""
    folder = output / "nodes"
    with graph(nodes, folder) as processes:
        return operate(settings, output, partial(require_running, processes, folder))


def operate(
    settings: NodeSettings, output: Path, require_running: Callable[[], None] = lambda: None
) -> tuple[list[ReachResult], Recorder]:
    """Join the graph and pursue the targets one after the other.

    Args:
        settings: Of the graph.
        output: Folder for what was heard, where the run is cut off.
        require_running: Raises where a node has ended.
    """
    machine = settings.machine
    goals = reach_goals(settings)
    with live_view(machine, settings.machine_directory, settings.coverage, settings.live_port) as taps:
        operator = Operator(machine, [*taps, UnfinishedBag(unfinished(output / LOGS / BAG), machine)])
        operator.wait_for_server(START_TIMEOUT_S, require_running)
        time.sleep(SETTLE_S)
        with kept_if_cut_off(output, machine, operator.recorder):
            results = operator.pursue(goals, settings.episodes.steps * machine.dt_s + GOAL_MARGIN_S)
    return results, operator.recorder


@contextlib.contextmanager
def kept_if_cut_off(output: Path, machine: MachineSpecification, recorder: Recorder) -> Iterator[None]:
    """Write what was heard where a goal never ends, a node dies or the user interrupts, and go on with that error."""
    try:
        yield
    except BaseException:
        if recorder.states and recorder.commands:
            try:
                write_run(output, machine, recorder.results, recorder)
            except OSError as trouble:
                print(f"what was heard until then could not be written: {trouble}", flush=True)
        raise


def reach_goals(settings: NodeSettings) -> list[ReachGoal]:
    """The targets' poses."""
    targets = settings.reaching.fixed_episodes(settings.targets).targets
    poses = settings.reaching.arm.forward(jnp.asarray(targets))
    return [
        ReachGoal(number, np.asarray(poses.position[number]), np.asarray(poses.quaternion[number]))
        for number in range(len(targets))
    ]


def simulate_targets(settings: NodeSettings) -> Recorder:
    """The same targets from the same start through the graph in simulated time: what the real one is held against."""
    episodes = settings.reaching.fixed_episodes(settings.targets)
    parts = graph_parts(settings)
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    machine: Machine = LearnedMachine(parts.step, episodes.starts[0])
    estimator = None
    if settings.driver is Driver.plant:
        machine, estimator = plant(settings)
    return run_successive(
        parts, controller_delays(settings), machine, estimator, episodes.targets, time.time_ns()
    )


def trials_of(folder: Path, settings: NodeSettings, ingest: IngestConfig) -> list[dict[str, Any]]:
    """Metrics of each trial in a bag, as `evaluate_logs` has them."""
    trials = trials_in(folder, settings.reaching, ingest, settings.loop_tracker)
    return reaching_summary(trials, settings.machine, settings.reaching.arm)["trials"] if trials else []


def write_run(
    output: Path, machine: MachineSpecification, results: Sequence[ReachResult], recorder: Recorder
) -> None:
    """How the goals ended, and a bag of what was heard."""
    output.mkdir(parents=True, exist_ok=True)
    content = [asdict(result) for result in results]
    write_json(output / RESULTS, content)
    write_bag_of(recorder, output / LOGS, machine)
    print(f"{len(results)} goals: {', '.join(result.outcome for result in results)}")


def write_bag_of(recorder: Recorder, folder: Path, machine: MachineSpecification) -> None:
    """One bag in place of an earlier run's, and of what a killed recorder would have left."""
    shutil.rmtree(folder / BAG, ignore_errors=True)
    recorder.write(folder / BAG, machine)
    unfinished(folder / BAG).unlink(missing_ok=True)


def refuse_others_logs(output: Path, folders: Sequence[str]) -> None:
    """Raise `InputError` where folders of bags, which are made anew, hold anything but an earlier run's bag."""
    is_run = (output / RESULTS).exists()  # written before any bag
    refuse_foreign(
        [output / folder for folder in folders],
        lambda entry: is_run and entry.name == BAG,
        "a finished run",
        "move them away, or name another output",
    )
