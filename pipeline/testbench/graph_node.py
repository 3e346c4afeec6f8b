"""Nodes of the ROS 1 graph, whatever stands in the machine's place: the learned model, the plant, or the machine."""

import gc
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pipeline.deployment.component import Component, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.controllers import at_rest
from pipeline.deployment.components.scripted_joystick import ScriptedJoystick
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.compose import graph_parts
from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import CanDriver
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep
from pipeline.deployment.nodes import AUTONOMOUS, JOYSTICK, Driver, NodeSettings
from pipeline.deployment.transports.ros1.can_bus import open_bus
from pipeline.deployment.transports.ros1.goal_errors import goal_errors
from pipeline.deployment.transports.ros1.node import Node
from pipeline.deployment.transports.ros1.observed_plc import ObservedPlc
from pipeline.effects.store import load_dynamics
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import ScriptedOperator as Painter
from pipeline.plant.recording.operator import draw_style
from pipeline.testbench.plant_machine import PlantMachine


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


def build(settings: NodeSettings, name: str) -> Node:
    """A node; what it runs is compiled before it joins the graph."""
    if name in AUTONOMOUS:
        return _server(settings)
    return Node(component(settings, name), settings.machine)


def component(settings: NodeSettings, name: str) -> Component:
    """What a node runs, of all but the server that takes goals."""
    machine, deployment = settings.machine, settings.deployment
    if name == "control_interface":
        return ControlInterface(machine, deployment.interface)
    if name == "control_supervisor":
        return supervise(machine, deployment, settings.machine_directory, settings.model)
    if name == "teleoperation_server":
        return TeleoperationServer(machine, deployment.teleoperation)
    if name == JOYSTICK:
        style_seed, seed = np.random.SeedSequence(settings.operator_seed).generate_state(2).tolist()
        painter = Painter(machine, draw_style(style_seed), seed)
        return ScriptedJoystick(machine, deployment.teleoperation, painter)
    if name == "emcb_200u_driver":
        return CanDriver(open_bus(settings.can), deployment.driver)
    if name == "bobcat_e10_driver":
        estimator = VelocityEstimator(nanoseconds(machine.dt_s), settings.loop_tracker)
        return MachineDriver(machine, CanFrames(machine, settings.machine_directory), estimator)
    if settings.driver is Driver.plant:
        driven, estimator = plant(settings)
        return SimulationDriver(driven, machine.n_joint, deployment.driver, estimator)
    return _learned_machine(settings, name)


def plant(settings: NodeSettings) -> tuple[PlantMachine, VelocityEstimator]:
    """The plant at the start of the first target, compiled, and what estimates its velocities."""
    machine = settings.machine
    parameters = simulated_machine(machine.name)
    start = settings.reaching.fixed_episodes(settings.targets).starts[0].astype(float)
    PlantMachine(parameters, settings.plant_seed, start).advance(np.zeros(machine.n_joint))
    estimator = VelocityEstimator(nanoseconds(machine.dt_s), settings.loop_tracker)
    return PlantMachine(parameters, settings.plant_seed, start), estimator


def _learned_machine(settings: NodeSettings, name: str) -> Component:
    """The learned model, behind the simulation's driver or behind the PLC."""
    machine, deployment = settings.machine, settings.deployment
    step = LearnedStep(settings.reaching.task(*load_dynamics(Path(settings.model)), settings.reward))
    start = settings.reaching.fixed_episodes(settings.targets).starts[0]
    LearnedMachine(step, start).advance(np.zeros(machine.n_joint))
    learned = LearnedMachine(step, start)
    if name == "bobcat_e10_sim_driver":
        return SimulationDriver(learned, machine.n_joint, deployment.driver)
    frames = CanFrames(machine, settings.machine_directory)
    return ObservedPlc(open_bus(settings.can), frames, learned, machine.n_joint, deployment.driver)


def _server(settings: NodeSettings) -> Node:
    parts = graph_parts(settings)
    start = settings.reaching.fixed_episodes(settings.targets).starts[0]
    state = at_rest(parts.task, start, start, parts.controller.observer)
    pose = parts.task.arm.forward(jnp.asarray(start))
    server = parts.server()
    server.rehearse(state, np.asarray(pose.position), np.asarray(pose.quaternion))
    return Node(server, settings.machine, goal_errors(parts.task.arm))
