"""Nodes of the ROS 1 graph, whatever stands in the machine's place: the learned model, the plant, or the machine."""

import gc
import time
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pipeline.deployment.component import Component, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.controllers import at_rest
from pipeline.deployment.components.scripted_joystick import ScriptedJoystick, Teleoperator
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.compose import graph_parts
from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import CanDriver
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep
from pipeline.deployment.nodes import AUTONOMOUS, JOYSTICK, WATCH, Driver, NodeSettings
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.ros1.can_bus import open_bus
from pipeline.deployment.transports.ros1.goal_errors import goal_errors
from pipeline.deployment.transports.ros1.node import Node
from pipeline.deployment.transports.ros1.observed_plc import ObservedPlc
from pipeline.discrepancy.experiment.plan import read_plan
from pipeline.discrepancy.experiment.player import PlanPlayer
from pipeline.effects.store import load_dynamics
from pipeline.errors import InputError
from pipeline.plant.machines.simulated import Condition
from pipeline.plant.recording.operator import ScriptedOperator as Painter
from pipeline.plant.recording.operator import draw_style
from pipeline.testbench.plant_machine import PlantMachine, changed_parameters


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
        return ControlInterface(machine, _supervised(settings).interface)
    if name == "control_supervisor":
        return supervise(machine, _supervised(settings), settings.machine_directory, settings.model)
    if name == "teleoperation_server":
        return TeleoperationServer(machine, deployment.teleoperation)
    if name == JOYSTICK:
        return ScriptedJoystick(machine, deployment.teleoperation, _operator(settings))
    if name == WATCH:
        # Other nodes need not wait for what finds causes to be imported.
        from pipeline.deployment.components.machine_watch import MachineWatch

        return MachineWatch(Path(str(settings.watch_state)), settings.watch_settings)
    if name == "emcb_200u_driver":
        return CanDriver(open_bus(settings.can), deployment.driver)
    if name == "bobcat_e10_driver":
        estimator = VelocityEstimator(nanoseconds(machine.dt_s), settings.loop_tracker)
        return MachineDriver(machine, CanFrames(machine, settings.machine_directory), estimator)
    if settings.driver is Driver.plant:
        driven, estimator = plant(settings)
        return SimulationDriver(driven, machine.n_joint, deployment.driver, estimator)
    return _learned_machine(settings, name)


def _operator(settings: NodeSettings) -> Teleoperator:
    """Who moves the scripted sticks."""
    machine = settings.machine
    if settings.plan is not None:
        return PlanPlayer(machine, read_plan(Path(settings.plan), machine))
    style_seed, seed = np.random.SeedSequence(settings.operator_seed).generate_state(2).tolist()
    return Painter(machine, draw_style(style_seed), seed)


def _supervised(settings: NodeSettings) -> DeploymentConfig:
    """Section `deployment`; where a plan is played the supervisor holds the plan's envelope, whatever else it does."""
    deployment, supervisor = settings.deployment, settings.deployment.supervisor
    if settings.plan is None:
        return deployment
    plan = read_plan(Path(settings.plan), settings.machine)
    held = replace(
        supervisor,
        rules=list(dict.fromkeys([*supervisor.rules, "envelope"])),
        warnings=[name for name in supervisor.warnings if name != "envelope"],
        envelope=plan.envelope,
        envelope_prediction_s=plan.stopping_s,
    )
    return replace(deployment, supervisor=held, interface=replace(deployment.interface, supervised=True))


def _start(settings: NodeSettings) -> np.ndarray:
    """Where the machine stands at the beginning, (n_joint,): as the plan wants it, or at the first target's start."""
    if settings.plan is None:
        return settings.reaching.fixed_episodes(settings.targets).starts[0]
    at = read_plan(Path(settings.plan), settings.machine).start
    return np.array([at[name] for name in settings.machine.joint_names], np.float32)


def plant(settings: NodeSettings) -> tuple[PlantMachine, VelocityEstimator]:
    """The plant, compiled, and what estimates its velocities."""
    machine = settings.machine
    draw = settings.effects, settings.effects_seed, settings.effect_size
    if settings.condition not in list(Condition):
        raise InputError(f"condition={settings.condition}: the plant has these: {', '.join(Condition)}")
    parameters = changed_parameters(machine.name, *draw, Condition(settings.condition), settings.plant_seed)
    start = _start(settings).astype(float)
    PlantMachine(parameters, settings.plant_seed, start).advance(np.zeros(machine.n_joint))
    estimator = VelocityEstimator(nanoseconds(machine.dt_s), settings.loop_tracker)
    return PlantMachine(parameters, settings.plant_seed, start), estimator


def _learned_machine(settings: NodeSettings, name: str) -> Component:
    """The learned model, behind the simulation's driver or behind the PLC."""
    machine, deployment = settings.machine, settings.deployment
    step = LearnedStep(settings.reaching.task(*load_dynamics(Path(settings.model)), settings.reward))
    start = _start(settings)
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
