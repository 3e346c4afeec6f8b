"""Somebody at a joystick drives the machine through the graph, and it is recorded as a bag."""

import contextlib
import enum
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.nodes import DRIVERS, JOYSTICK, NODES, TELEOPERATED, NodeSettings
from pipeline.deployment.transports.ros1.launch import graph, require_running
from pipeline.deployment.transports.ros1.listener import Listener
from pipeline.deployment.transports.simulated_time.delays import delays_of, load_delays
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph, Tap
from pipeline.deployment.transports.simulated_time.pace import run_at_real_time
from pipeline.deployment.transports.unfinished_bag import UnfinishedBag, unfinished
from pipeline.deployment.viewing.live_view import live_view
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import SESSION_NAME
from pipeline.testbench.graph_node import component
from pipeline.testbench.target_run import SETTLE_S, START_TIMEOUT_S


class GraphKind(enum.StrEnum):
    """What carries the graph's messages."""

    ros = "ros"
    simulated_time = "simulated_time"


class Sticks(enum.StrEnum):
    """Who moves the sticks."""

    scripted = "scripted"
    device = "device"  # a node of the joystick's own


@dataclass(frozen=True, kw_only=True)
class TeleoperationSettings(NodeSettings):
    """What a teleoperated graph is composed of.

    Attributes:
        seconds: How long it is recorded.
    """

    graph: GraphKind
    joystick: Sticks
    seconds: float

    @property
    def commanding(self) -> tuple[str, ...]:
        """Nodes that commands come from."""
        return (*TELEOPERATED, JOYSTICK) if self.joystick is Sticks.scripted else TELEOPERATED


def record_teleoperation(
    settings: TeleoperationSettings, nodes: Mapping[str, Sequence[str]], output: Path
) -> dict[str, int]:
    """Run the graph, as ROS nodes by their commands or in simulated time, and write one more bag; its counts."""
    folder, port = settings.machine_directory, settings.live_port
    with live_view(settings.machine, folder, settings.coverage, port) as taps:
        if settings.graph is GraphKind.simulated_time:
            recorder = _simulate(settings, output, taps)
        else:
            recorder = _drive(settings, nodes, output, taps)
    return {
        "joint_states": len(recorder.states),
        "moving_commands": moving(recorder),
        "stops": len(recorder.stops),
    }


@contextlib.contextmanager
def kept(
    recorder: Recorder, machine: MachineSpecification, output: Path, so_far: Path | None = None
) -> Iterator[None]:
    """Write what is recorded meanwhile, however that ends; Ctrl-C is the way to end it early, and no error.

    Args:
        recorder: What is recorded.
        machine: Of the bag.
        output: Parent of the folder of bags.
        so_far: File of an `UnfinishedBag`, which is deleted then.

    Raises:
        InputError: There was nothing to write.
    """
    try:
        with contextlib.suppress(KeyboardInterrupt):
            yield
    finally:
        for stop in recorder.stops:
            print(f"control_supervisor stopped the machine by {stop.rule}: {stop.detail}")
        is_log = bool(recorder.states and recorder.commands)
        if is_log:
            begun_s = recorder.states[0][0] // NANOSECONDS
            bag = output / "logs" / datetime.fromtimestamp(begun_s, UTC).strftime(SESSION_NAME)
            recorder.write(bag, machine)
            said = f"{len(recorder.states)} joint states, {moving(recorder)} commands that move a joint"
            print(f"recorded {bag}: {said}", flush=True)
        if so_far is not None:
            so_far.unlink(missing_ok=True)
    if not is_log:
        raise InputError("no stick was moved while it was recorded, so there is no bag; see the nodes' logs")


def moving(recorder: Recorder) -> int:
    """How many commands move a joint."""
    return sum(bool(np.any(command.values)) for _, command in recorder.commands)


def _drive(
    settings: TeleoperationSettings, nodes: Mapping[str, Sequence[str]], output: Path, taps: Sequence[Tap]
) -> Recorder:
    """The graph as ROS 1 nodes, at wall-clock time.

    Raises:
        InputError: ROS 1 is not installed, or a node ended.
    """
    folder = output / "nodes"
    with graph(nodes, folder) as processes:
        all_running = partial(require_running, processes, folder)
        if settings.joystick is Sticks.device:
            print(
                f"teleoperate: waits for a joystick on /joystick, ROS_MASTER_URI={os.environ['ROS_MASTER_URI']}",
                flush=True,
            )
        so_far = unfinished(output / "logs" / datetime.now(UTC).strftime(SESSION_NAME))
        listener = Listener(settings.machine, "recorder", [*taps, UnfinishedBag(so_far, settings.machine)])
        listener.wait_for_nodes(len(nodes), START_TIMEOUT_S, all_running)
        time.sleep(SETTLE_S)
        # before the nodes are ended, which takes them seconds
        with kept(listener.recorder, settings.machine, output, so_far):
            listener.listen(settings.seconds, all_running)
    return listener.recorder


def _simulate(settings: TeleoperationSettings, output: Path, taps: Sequence[Tap]) -> Recorder:
    """The same components in simulated time, at real time where somebody watches."""
    recorder, deployment = Recorder(), settings.deployment
    names = (*DRIVERS[settings.driver], *NODES, *settings.commanding, *settings.watching)
    components = [component(settings, name) for name in names]
    delays, _ = delays_of(load_delays(Path(deployment.delays)).links, ControllerKind.ppo, None)
    start_ns = time.time_ns()
    simulated = SimulatedGraph(
        components, delays, np.random.SeedSequence(deployment.seed), start_ns, taps=[recorder, *taps]
    )
    run = SimulatedGraph.run if not taps else run_at_real_time
    with kept(recorder, settings.machine, output):
        run(simulated, start_ns + nanoseconds(settings.seconds))
    return recorder
