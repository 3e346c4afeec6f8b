"""Stage `graph_node`: one node of the ROS 1 graph, a process of its own; started by `run_graph` or by roslaunch."""

import contextlib
import enum
import gc
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.stage import stage
from pipeline.deployment.component import Component, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.control_supervisor import ControlSupervisor
from pipeline.deployment.components.controllers import ControllerState
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.components.scripted_joystick import ScriptedJoystick
from pipeline.deployment.components.supervisor_rules import build_rules
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import CanDriver
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep
from pipeline.deployment.messages import ReachGoal, ReachResult
from pipeline.deployment.transports.ros1.can_bus import CanBusConfig, open_bus
from pipeline.deployment.transports.ros1.goal_errors import goal_errors
from pipeline.deployment.transports.ros1.node import Node
from pipeline.deployment.transports.ros1.observed_plc import ObservedPlc
from pipeline.deployment.transports.ros1.operator import Operator
from pipeline.deployment.viewing.live_view import live_view
from pipeline.effects.store import load_dynamics
from pipeline.errors import InputError
from pipeline.logs.formats.recorded_folders import refuse_foreign
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import ScriptedOperator as Painter
from pipeline.plant.recording.operator import draw_style
from pipeline.reaching.episodes import Episodes, evaluation_episodes
from pipeline.reaching.task import ReachingTask
from pipeline.stages.sim2real import PlantMachine
from pipeline.stages.sim2sim import Sim2SimStage, graph_parts
from pipeline.tracking import StageRun

START_TIMEOUT_S = 300.0  # until all nodes have compiled what they run
GOAL_MARGIN_S = 15.0  # beyond the time-out of a goal, before it counts as lost
SETTLE_S = 1.0  # for connections between nodes
OPERATOR = "operator"
RESULTS, LOGS, BAG = "results.json", "logs", "targets"  # what a run over targets writes
NODES = ("control_interface", "control_supervisor")
AUTONOMOUS = ("autonomous_server",)
TELEOPERATED = ("teleoperation_server",)
JOYSTICK = ScriptedJoystick.name


class Driver(enum.StrEnum):
    """What stands in the machine's place."""

    simulated = "simulated"  # bobcat_e10_sim_driver with the learned model
    plant = "plant"  # bobcat_e10_sim_driver with the plant, a stand-in for the excavator
    can = "can"  # the machine's own drivers; at the other end of the bus a simulated PLC


DRIVERS = {
    Driver.simulated: ("bobcat_e10_sim_driver",),
    Driver.plant: ("bobcat_e10_sim_driver",),
    Driver.can: ("plc", "emcb_200u_driver", "bobcat_e10_driver"),
}


@dataclass
class GraphStage(Sim2SimStage):
    """Keys of every stage that runs the real graph."""

    targets: int = MISSING
    driver: Driver = Driver.simulated
    plant_seed: int = MISSING
    operator_seed: int = MISSING
    live_port: int | None = None
    can: CanBusConfig = MISSING

    def __post_init__(self) -> None:
        if isinstance(self.targets, int) and self.targets < 1:
            raise InputError(f"targets is {self.targets}; it must be at least 1")


@dataclass
class GraphNodeStage(GraphStage):
    """Keys of `conf/graph_node.yaml`."""

    node: str = MISSING


@stage(GraphNodeStage)
def main(configuration: GraphNodeStage, run: StageRun) -> None:
    """Be one node until the graph is shut down; or the operator, until all targets have been pursued."""
    driving = [*DRIVERS[Driver.simulated], *DRIVERS[Driver.can]]
    known = [*NODES, *AUTONOMOUS, *TELEOPERATED, JOYSTICK, *driving, OPERATOR]
    if configuration.node not in known:
        raise InputError(f"node={configuration.node}: no such node; known are {', '.join(known)}")
    jax.config.update(
        "jax_cpu_enable_async_dispatch", False
    )  # calls are so short that handing them over costs more
    if configuration.node == OPERATOR:
        refuse_others_logs(Path(configuration.output), [LOGS])
        results, recorder = operate(configuration)
        write_run(configuration, results, recorder)
        return
    node = build(configuration, configuration.node)
    taken_ms = 1e3 * freeze_loaded()
    print(
        f"{configuration.node}: {taken_ms:.0f} ms for a full collection of garbage, the last one", flush=True
    )
    node.spin()
    node.save(Path(configuration.output) / "nodes" / f"{configuration.node}.json")


def freeze_loaded() -> float:
    """Keep what is loaded by now out of garbage collection: to go through all of it stops every thread for some ticks.

    Returns:
        How long that took, s.
    """
    begin = time.perf_counter()
    gc.collect()
    taken_s = time.perf_counter() - begin
    gc.freeze()
    return taken_s


def node_commands(
    configuration: GraphStage, overrides: Sequence[str], commanding: Sequence[str] = AUTONOMOUS
) -> dict[str, list[str]]:
    """The commands of all nodes, with those overrides of this command that a node knows.

    Args:
        configuration: names the drivers.
        overrides: of this command.
        commanding: nodes that commands come from.
    """
    known = {field.name for field in fields(GraphNodeStage)} - {"tracking"} | {"profile"}
    passed = [word for word in overrides if word.lstrip("+~").split("=")[0].split(".")[0] in known]
    command = [sys.executable, "-m", "pipeline.stages.graph_node", *passed]
    return {
        name: [*command, f"node={name}"] for name in (*DRIVERS[configuration.driver], *NODES, *commanding)
    }


def build(configuration: GraphStage, name: str) -> Node:
    """A node; what it runs is compiled before it joins the graph."""
    if name in AUTONOMOUS:
        return _server(configuration)
    return Node(component(configuration, name), configuration.machine)


def component(configuration: GraphStage, name: str) -> Component:
    """What a node runs, of all but the server that takes goals."""
    machine, deployment = configuration.machine, configuration.deployment
    if name == "control_interface":
        return ControlInterface(machine, deployment.interface)
    if name == "control_supervisor":
        rules = build_rules(machine, deployment.supervisor, MACHINE_DIRECTORY)
        return ControlSupervisor(rules, deployment.supervisor.period_s)
    if name == "teleoperation_server":
        return TeleoperationServer(machine, deployment.teleoperation)
    if name == JOYSTICK:
        style_seed, seed = np.random.SeedSequence(configuration.operator_seed).generate_state(2).tolist()
        painter = Painter(machine, draw_style(style_seed), seed)
        return ScriptedJoystick(machine, deployment.teleoperation, painter)
    if name == "emcb_200u_driver":
        return CanDriver(open_bus(configuration.can), deployment.driver)
    if name == "bobcat_e10_driver":
        estimator = VelocityEstimator(nanoseconds(machine.dt_s), configuration.control.loop_tracker)
        return MachineDriver(machine, CanFrames(machine, MACHINE_DIRECTORY), estimator)
    if configuration.driver is Driver.plant:
        driven, estimator = plant(configuration)
        return SimulationDriver(driven, machine.n_joint, deployment.driver, estimator)
    return _machine(configuration, name)


def plant(configuration: GraphStage) -> tuple[PlantMachine, VelocityEstimator]:
    """The plant at the start of the first target, compiled, and what estimates its velocities."""
    machine = configuration.machine
    parameters, start = simulated_machine(machine.name), fixed_episodes(configuration).starts[0].astype(float)
    PlantMachine(parameters, configuration.plant_seed, start).advance(np.zeros(machine.n_joint))
    estimator = VelocityEstimator(nanoseconds(machine.dt_s), configuration.control.loop_tracker)
    return PlantMachine(parameters, configuration.plant_seed, start), estimator


def _machine(configuration: GraphStage, name: str) -> Component:
    """The learned model, behind the simulation's driver or behind the PLC."""
    machine, deployment = configuration.machine, configuration.deployment
    dynamics, parameters = load_dynamics(Path(configuration.model))
    arm = load_arm(machine, MACHINE_DIRECTORY)
    step = LearnedStep(ReachingTask(machine, arm, dynamics, parameters, configuration.reward))
    start = fixed_episodes(configuration).starts[0]
    LearnedMachine(step, start).advance(np.zeros(machine.n_joint))
    learned = LearnedMachine(step, start)
    if name == "bobcat_e10_sim_driver":
        return SimulationDriver(learned, machine.n_joint, deployment.driver)
    frames = CanFrames(machine, MACHINE_DIRECTORY)
    return ObservedPlc(open_bus(configuration.can), frames, learned, machine.n_joint, deployment.driver)


def _server(configuration: GraphStage) -> Node:
    machine = configuration.machine
    parts = graph_parts(configuration, machine)
    start = fixed_episodes(configuration).starts[0]
    history = parts.task.dynamics.initial_history(jnp.asarray(start))
    state = ControllerState(np.asarray(history.motion), np.asarray(history.commands), start, start)
    pose = parts.task.arm.forward(jnp.asarray(start))
    server = parts.server()
    server.rehearse(state, np.asarray(pose.position), np.asarray(pose.quaternion))
    return Node(server, machine, goal_errors(parts.task.arm))


def operate(
    configuration: GraphStage, require_running: Callable[[], None] = lambda: None
) -> tuple[list[ReachResult], Recorder]:
    """Join the graph and pursue the targets one after the other.

    Args:
        configuration: names the targets.
        require_running: raises where a node has ended.
    """
    machine = configuration.machine
    goals = reach_goals(configuration)
    with live_view(machine, MACHINE_DIRECTORY, configuration.live_port) as taps:
        operator = Operator(machine, taps)
        operator.wait_for_server(START_TIMEOUT_S, require_running)
        time.sleep(SETTLE_S)
        with kept_if_cut_off(configuration, operator.recorder):
            results = operator.pursue(goals, configuration.episodes.steps * machine.dt_s + GOAL_MARGIN_S)
    return results, operator.recorder


@contextlib.contextmanager
def kept_if_cut_off(configuration: GraphStage, recorder: Recorder) -> Iterator[None]:
    """Write what was heard where a goal never ends, a node dies or the user interrupts, and go on with that error."""
    try:
        yield
    except BaseException:
        if recorder.states and recorder.commands:
            try:
                write_run(configuration, recorder.results, recorder)
            except OSError as trouble:
                print(f"what was heard until then could not be written: {trouble}", flush=True)
        raise


def reach_goals(configuration: GraphStage) -> list[ReachGoal]:
    """The targets' poses."""
    targets = fixed_episodes(configuration).targets
    poses = load_arm(configuration.machine, MACHINE_DIRECTORY).forward(jnp.asarray(targets))
    return [
        ReachGoal(number, np.asarray(poses.position[number]), np.asarray(poses.quaternion[number]))
        for number in range(len(targets))
    ]


def write_run(configuration: GraphStage, results: Sequence[ReachResult], recorder: Recorder) -> None:
    """How the goals ended, and a bag of what was heard."""
    output = Path(configuration.output)
    output.mkdir(parents=True, exist_ok=True)
    content = [asdict(result) for result in results]
    (output / RESULTS).write_text(json.dumps(content, indent=1) + "\n")
    write_bag_of(recorder, output / LOGS, configuration.machine)
    print(f"{len(results)} goals: {', '.join(result.outcome for result in results)}")


def write_bag_of(recorder: Recorder, folder: Path, machine: MachineSpecification) -> None:
    """One bag in place of what is in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    recorder.write(folder / BAG, machine)


def refuse_others_logs(output: Path, folders: Sequence[str]) -> None:
    """Raise `InputError` where folders of bags, which are made anew, hold anything but an earlier run's bag."""
    is_run = (output / RESULTS).exists()  # written before any bag
    refuse_foreign(
        [output / folder for folder in folders],
        lambda entry: is_run and entry.name == BAG,
        "this stage",
        "move them away, or name another output",
    )


def fixed_episodes(configuration: GraphStage) -> Episodes:
    """The first episodes of the evaluation, as many as there are targets to give."""
    conditions = configuration.episodes
    arm = load_arm(configuration.machine, MACHINE_DIRECTORY)
    episodes = evaluation_episodes(
        configuration.machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    return episodes.first(configuration.targets)


if __name__ == "__main__":
    sys.argv = [word for word in sys.argv if ":=" not in word]  # roslaunch's; the node takes them by itself
    main()
