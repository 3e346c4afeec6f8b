"""Stage `teleoperate`: somebody at a joystick drives the machine through the graph, and it is recorded as a bag."""

import contextlib
import enum
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.stage import stage
from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.transports.ros1.launch import graph, require_running
from pipeline.deployment.transports.ros1.listener import Listener
from pipeline.deployment.transports.simulated_time.delays import delays_of, load_delays
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph, Tap
from pipeline.deployment.transports.simulated_time.pace import run_at_real_time
from pipeline.deployment.viewing.live_view import live_view
from pipeline.errors import InputError
from pipeline.plant.recording.session import SESSION_NAME
from pipeline.stages.graph_node import (
    DRIVERS,
    JOYSTICK,
    NODES,
    SETTLE_S,
    START_TIMEOUT_S,
    TELEOPERATED,
    Driver,
    GraphStage,
    component,
    node_commands,
)
from pipeline.stages.processes.overrides import of_this_job, replaced
from pipeline.stages.processes.own_process import for_this_job
from pipeline.tracking import StageRun


class GraphKind(enum.StrEnum):
    """What carries the graph's messages."""

    ros = "ros"
    simulated_time = "simulated_time"


class Sticks(enum.StrEnum):
    """Who moves the sticks."""

    scripted = "scripted"
    device = "device"  # a node of the joystick's own


@dataclass
class TeleoperateStage(GraphStage):
    """Keys of `conf/teleoperate.yaml`."""

    graph: GraphKind = MISSING
    joystick: Sticks = MISSING
    seconds: float = MISSING

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.seconds > 0:
            raise InputError(f"seconds={self.seconds}: it must be positive")
        if self.driver is not Driver.plant and not self.model:
            raise InputError(
                f"`model` is missing; driver={self.driver} takes model=FOLDER that identify wrote"
            )
        if self.graph is GraphKind.simulated_time and (
            self.driver is Driver.can or self.joystick is Sticks.device
        ):
            raise InputError(
                "graph=simulated_time: takes neither driver=can nor joystick=device, which keep real time"
            )

    @property
    def commanding(self) -> tuple[str, ...]:
        """Nodes that commands come from."""
        return (*TELEOPERATED, JOYSTICK) if self.joystick is Sticks.scripted else TELEOPERATED


@stage(TeleoperateStage)
def main(configuration: TeleoperateStage, run: StageRun) -> None:
    """Run the graph for so many seconds; write what it heard as one more bag in the folder `logs` of the output."""
    for name in configuration.commanding:
        component(configuration, name)  # a mistake in their settings is told here, not in a node's log
    if configuration.graph is GraphKind.simulated_time:
        counts = record(configuration, ())
    else:
        # what this stage has other than a node by default
        own = {"driver": configuration.driver, "model": configuration.model}
        counts = for_this_job(record, configuration, replaced(of_this_job(configuration), own))
    run.metrics(counts)


def record(configuration: TeleoperateStage, overrides: Sequence[str]) -> dict[str, int]:
    """Run the graph, whose nodes are given the overrides, and write the bag; how much there is of what."""
    with live_view(configuration.machine, MACHINE_DIRECTORY, configuration.live_port) as taps:
        if configuration.graph is GraphKind.simulated_time:
            recorder = simulate(configuration, taps)
        else:
            recorder = drive(configuration, overrides, taps)
    return {
        "joint_states": len(recorder.states),
        "moving_commands": moving(recorder),
        "stops": len(recorder.stops),
    }


@contextlib.contextmanager
def kept(recorder: Recorder, configuration: TeleoperateStage) -> Iterator[None]:
    """Write what is recorded meanwhile, however that ends; Ctrl-C is the way to end it early, and no error.

    Raises:
        InputError: there was nothing to write.
    """
    try:
        with contextlib.suppress(KeyboardInterrupt):
            yield
    finally:
        for stop in recorder.stops:
            print(f"teleoperate: control_supervisor stopped the machine by {stop.rule}: {stop.detail}")
        is_log = bool(recorder.states and recorder.commands)
        if is_log:
            begun_s = recorder.states[0][0] // NANOSECONDS
            session = datetime.fromtimestamp(begun_s, UTC).strftime(SESSION_NAME)
            bag = Path(configuration.output) / "logs" / session
            recorder.write(bag, configuration.machine)
            said = f"{len(recorder.states)} joint states, {moving(recorder)} commands that move a joint"
            print(f"teleoperate: {bag}: {said}", flush=True)
    if not is_log:
        raise InputError("no stick was moved while it was recorded, so there is no bag; see the nodes' logs")


def moving(recorder: Recorder) -> int:
    """How many commands move a joint."""
    return sum(bool(np.any(command.values)) for _, command in recorder.commands)


def drive(configuration: TeleoperateStage, overrides: Sequence[str], taps: Sequence[Tap]) -> Recorder:
    """The graph as ROS 1 nodes, at wall-clock time.

    Raises:
        InputError: ROS 1 is not installed, or a node ended.
    """
    nodes = node_commands(configuration, overrides, configuration.commanding)
    folder = Path(configuration.output) / "nodes"
    with graph(nodes, folder) as processes:
        all_running = partial(require_running, processes, folder)
        if configuration.joystick is Sticks.device:
            print(
                f"teleoperate: waits for a joystick on /joystick, ROS_MASTER_URI={os.environ['ROS_MASTER_URI']}",
                flush=True,
            )
        listener = Listener(configuration.machine, "recorder", taps)
        listener.wait_for_nodes(len(nodes), START_TIMEOUT_S, all_running)
        time.sleep(SETTLE_S)
        with kept(listener.recorder, configuration):  # before the nodes are ended, which takes them seconds
            listener.listen(configuration.seconds, all_running)
    return listener.recorder


def simulate(configuration: TeleoperateStage, taps: Sequence[Tap]) -> Recorder:
    """The same components in simulated time, at real time where somebody watches."""
    recorder, deployment = Recorder(), configuration.deployment
    names = (*DRIVERS[configuration.driver], *NODES, *configuration.commanding)
    components = [component(configuration, name) for name in names]
    delays, _ = delays_of(load_delays(Path(deployment.delays)).links, ControllerKind.ppo, None)
    start_ns = time.time_ns()
    simulated = SimulatedGraph(
        components, delays, np.random.SeedSequence(deployment.seed), start_ns, taps=[recorder, *taps]
    )
    run = SimulatedGraph.run if not taps else run_at_real_time
    with kept(recorder, configuration):
        run(simulated, start_ns + nanoseconds(configuration.seconds))
    return recorder


if __name__ == "__main__":
    main()
