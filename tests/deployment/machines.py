"""A machine, a controller and a graph for tests: plain integration, no learned model, nothing compiled."""

import dataclasses
from collections.abc import Sequence
from functools import cache

import can
import numpy as np

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import Component, nanoseconds
from pipeline.deployment.components.autonomous_server import AutonomousServer
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.controllers import ControllerState
from pipeline.deployment.components.state_buffers import Observer
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.supervision.supervisor_rules import RULES
from pipeline.deployment.components.termination import TerminalConditions
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import CanDriver
from pipeline.deployment.drivers.machine import Sample
from pipeline.deployment.drivers.programmable_controller import ProgrammableController
from pipeline.deployment.settings import DeploymentConfig
from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.specification import MachineSpecification

SPEED = 0.2  # rad/s of every joint
NOISE = 2e-4  # rad
MIDDLE = np.array([0.0, 1.0, -1.6, -0.7])  # joints 0.18 rad about it stay in W+


@cache
def bobcat() -> MachineSpecification:
    return load_machine("bobcat_e10")


@cache
def arm() -> Arm:
    return load_arm(bobcat(), MACHINE_DIRECTORY)


@cache
def paper() -> DeploymentConfig:
    return load_section("deployment", DeploymentConfig)


@cache
def conditions() -> TerminalConditions:
    """Of the paper; compiled once."""
    return TerminalConditions(bobcat(), arm(), paper().termination)


@cache
def frames() -> CanFrames:
    return CanFrames(bobcat(), MACHINE_DIRECTORY)


@cache
def supervised() -> DeploymentConfig:
    """All rules on."""
    config = paper()
    return dataclasses.replace(
        config,
        supervisor=dataclasses.replace(config.supervisor, rules=list(RULES)),
        interface=dataclasses.replace(config.interface, supervised=True),
    )


def specification(lags: int = 2, target: Target = Target.dqdot) -> ModelSpecification:
    machine = bobcat()
    n = machine.n_joint
    return ModelSpecification(
        parameterization=Parameterization.mlp,
        target=target,
        hidden=[2],
        lags=lags,
        legendre_degree=1,
        joints=list(machine.joint_names),
        rate_hz=machine.rate_hz,
        position_lower=machine.lower.tolist(),
        position_upper=machine.upper.tolist(),
        velocity_limit=[1.0] * n,
        residual_scale=[1.0] * n,
    )


class Integrator:
    """q += SPEED * command * dt, read with a little noise, as an encoder gives it."""

    def __init__(self, start: np.ndarray = MIDDLE, period_s: float = 0.02, noise: float = NOISE) -> None:
        self.period_ns = nanoseconds(period_s)
        self._period_s = period_s
        self._noise = noise
        self._random = np.random.default_rng(0)
        self.q = np.array(start, float)

    def read(self) -> Sequence[Sample]:
        return (Sample(0, self.q + self._noise * self._random.standard_normal(self.q.size), None),)

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        self.q = self.q + SPEED * self._period_s * np.asarray(command)
        return self.read()


class BackAndForth:
    """Drives every joint up and down about the middle of its range; `values` in place of that, if set."""

    observer: Observer | None = None

    def __init__(self) -> None:
        self._direction = np.ones(4, np.float32)
        self.values: np.ndarray | None = None
        self.n_begun = 0

    def begin(self, goal_id: int) -> None:
        self.n_begun += 1

    def fresh(self) -> "BackAndForth":
        return self

    def decide(self, state: ControllerState) -> np.ndarray:
        away = np.abs(state.q - MIDDLE) > 0.1
        self._direction = np.where(away, -np.sign(state.q - MIDDLE), self._direction).astype(np.float32)
        return self._direction if self.values is None else self.values


def server(controller: BackAndForth, ticks: int = 500) -> AutonomousServer:
    return AutonomousServer(
        bobcat(),
        specification(),
        controller,
        lambda position, quaternion, q: MIDDLE.astype(np.float32) if np.isfinite(position).all() else None,
        conditions(),
        action_repeats=4,
        maximum_ticks=ticks,
    )


def estimator() -> VelocityEstimator:
    return VelocityEstimator(nanoseconds(0.05), LoopTrackerConfig(10.0, 60.0))


def can_graph(
    controller: BackAndForth, bus: can.BusABC, plc_bus: can.BusABC, rules: Sequence[str] = tuple(RULES)
) -> list[Component]:
    """The whole graph of the real machine, with a simulated PLC at the other end of the bus."""
    config = supervised()
    supervisor = dataclasses.replace(config.supervisor, rules=list(rules))
    return [
        server(controller),
        supervise(bobcat(), dataclasses.replace(config, supervisor=supervisor), MACHINE_DIRECTORY),
        ControlInterface(bobcat(), config.interface),
        MachineDriver(bobcat(), frames(), estimator()),
        CanDriver(bus, config.driver),
        ProgrammableController(plc_bus, frames(), Integrator(), bobcat().n_joint, config.driver),
    ]
