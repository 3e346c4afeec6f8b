"""Stage `run_graph`: the graph as ROS 1 nodes at wall-clock time, the learned model in the machine's place."""

import json
import shutil
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from omegaconf import MISSING

from pipeline.configuration import MACHINE_DIRECTORY, stage
from pipeline.deployment.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.component import Component
from pipeline.deployment.control_interface import ControlInterface
from pipeline.deployment.control_supervisor import ControlSupervisor
from pipeline.deployment.controllers import ControllerState
from pipeline.deployment.goals import known_configurations
from pipeline.deployment.machine import LearnedMachine
from pipeline.deployment.messages import ReachGoal, ReachResult
from pipeline.deployment.recording import Recorder
from pipeline.deployment.ros1.goal_errors import goal_errors
from pipeline.deployment.ros1.launch import graph
from pipeline.deployment.ros1.node import Node
from pipeline.deployment.ros1.operator import Operator
from pipeline.deployment.simulated_time.delays import load_delays
from pipeline.deployment.successive import run_successive
from pipeline.deployment.supervisor_rules import build_rules
from pipeline.errors import InputError
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import Episodes, evaluation_episodes
from pipeline.stages.sim2sim import Sim2SimStage, policy_parts
from pipeline.tracking import StageRun

NODES = ("bobcat_e10_sim_driver", "control_interface", "control_supervisor", "autonomous_server")
START_TIMEOUT_S = 300.0  # until all nodes have compiled what they run
GOAL_MARGIN_S = 15.0  # beyond the time-out of a goal, before it counts as lost
SETTLE_S = 1.0  # for connections between nodes


@dataclass
class TargetsStage(Sim2SimStage):
    """Keys of every stage that runs the real graph."""

    targets: int = MISSING


@dataclass
class RunGraphStage(TargetsStage):
    """Keys of `conf/run_graph.yaml`."""

    node: str | None = None

    def __post_init__(self) -> None:
        if self.node is not None and self.node not in NODES:
            raise InputError(f"node={self.node}: no such node; known are {', '.join(NODES)}")


@stage(RunGraphStage)
def main(configuration: RunGraphStage, run: StageRun) -> None:
    """Launch the graph and give it its targets; or be one of its nodes."""
    if configuration.node is not None:
        run_node(configuration, configuration.node)
        return
    output = Path(configuration.output)
    results, recorder = run_targets(configuration, sys.argv[1:])
    content = [asdict(result) for result in results]
    (output / "results.json").write_text(json.dumps(content, indent=1) + "\n")
    for folder, recorded in (("logs", recorder), ("simulated", simulate(configuration))):
        shutil.rmtree(output / folder, ignore_errors=True)
        recorded.write(output / folder / "targets", configuration.machine)
    print(f"run_graph: {len(results)} goals: {', '.join(result.outcome for result in results)}")


def simulate(configuration: TargetsStage) -> Recorder:
    """The same targets from the same start through the graph in simulated time: what the real one is held against."""
    episodes = fixed_episodes(configuration)
    parts = policy_parts(configuration, configuration.machine)
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    delays = load_delays(Path(configuration.deployment.delays))
    machine = LearnedMachine(parts.step, episodes.starts[0])
    return run_successive(parts, delays, machine, None, episodes.targets, time.time_ns())


def run_targets(configuration: TargetsStage, overrides: list[str]) -> tuple[list[ReachResult], Recorder]:
    """Launch the nodes with the overrides of this command, pursue the targets, shut the nodes down."""
    output, machine = Path(configuration.output), configuration.machine
    nodes = {
        name: [sys.executable, "-m", "pipeline.stages.run_graph", *overrides, f"node={name}"]
        for name in NODES
    }
    episodes = fixed_episodes(configuration)
    poses = load_arm(machine, MACHINE_DIRECTORY).forward(jnp.asarray(episodes.targets))
    goals = [
        ReachGoal(number, np.asarray(poses.position[number]), np.asarray(poses.quaternion[number]))
        for number in range(len(episodes.targets))
    ]
    with graph(nodes, output / "nodes") as processes:
        operator = Operator(machine)
        operator.wait_for_server(
            START_TIMEOUT_S, lambda: all(process.poll() is None for process in processes.values())
        )
        time.sleep(SETTLE_S)
        results = operator.pursue(goals, configuration.episodes.steps * machine.dt_s + GOAL_MARGIN_S)
    return results, operator.recorder


def fixed_episodes(configuration: TargetsStage) -> Episodes:
    """The first episodes of the evaluation, as many as there are targets to give."""
    conditions = configuration.episodes
    arm = load_arm(configuration.machine, MACHINE_DIRECTORY)
    episodes = evaluation_episodes(
        configuration.machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    return episodes.first(configuration.targets)


def run_node(configuration: RunGraphStage, name: str) -> None:
    """Be one node until the graph is shut down."""
    component = build(configuration, name)
    errors = None
    if name == "autonomous_server":
        errors = goal_errors(load_arm(configuration.machine, MACHINE_DIRECTORY))
    node = Node(component, configuration.machine, errors)
    node.spin()
    node.save(Path(configuration.output) / "nodes" / f"{name}.json")


def build(configuration: RunGraphStage, name: str) -> Component:
    """The component of a node; what it runs is compiled before it starts."""
    machine, deployment = configuration.machine, configuration.deployment
    if name == "control_interface":
        return ControlInterface(machine, deployment.interface)
    if name == "control_supervisor":
        rules = build_rules(machine, deployment.supervisor, MACHINE_DIRECTORY)
        return ControlSupervisor(rules, deployment.supervisor.period_s)
    parts = policy_parts(configuration, machine)
    start = fixed_episodes(configuration).starts[0]
    if name == "bobcat_e10_sim_driver":
        LearnedMachine(parts.step, start).advance(np.zeros(machine.n_joint))
        return SimulationDriver(LearnedMachine(parts.step, start), machine.n_joint, deployment.driver)
    history = parts.task.dynamics.initial_history(jnp.asarray(start))
    motion, commands = np.asarray(history.motion), np.asarray(history.commands)
    parts.controller.decide(ControllerState(motion, commands, start, start))
    return parts.server()


if __name__ == "__main__":
    main()
