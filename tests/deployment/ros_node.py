"""One node of the tests' real graph: `python -m tests.deployment.ros_node NAME FOLDER`.

What a node does not need is not imported: each one is a process of its own.
"""

import dataclasses
import sys
from pathlib import Path

from pipeline.configuration import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import Component
from pipeline.deployment.ros1.node import Node
from pipeline.deployment.settings import DeploymentConfig

NODES = ("bobcat_e10_sim_driver", "control_interface", "control_supervisor", "autonomous_server")
GOAL_TICKS = 30
SILENCE_S = 1.0  # of the encoders, until the supervisor stops the machine
PATIENCE_S = 10.0  # other limits: nothing else may stop it, however busy this computer is


def config() -> DeploymentConfig:
    """One rule is on: that joint states come at all."""
    paper = load_section("deployment", DeploymentConfig)
    supervisor = dataclasses.replace(
        paper.supervisor,
        rules=["state_frequency"],
        maximum_state_gap_s=SILENCE_S,
        maximum_state_delay_s=PATIENCE_S,
    )
    driver = dataclasses.replace(paper.driver, command_timeout_s=PATIENCE_S)
    return dataclasses.replace(paper, supervisor=supervisor, driver=driver)


def build(name: str) -> Component:
    machine = load_machine("bobcat_e10")
    if name == "control_interface":
        from pipeline.deployment.control_interface import ControlInterface

        return ControlInterface(machine, config().interface)
    if name == "control_supervisor":
        from pipeline.deployment.control_supervisor import ControlSupervisor
        from pipeline.deployment.supervisor_rules import build_rules

        supervisor = config().supervisor
        return ControlSupervisor(build_rules(machine, supervisor, MACHINE_DIRECTORY), supervisor.period_s)
    from tests.deployment.machines import BackAndForth, Integrator, estimator, server

    if name == "autonomous_server":
        return server(BackAndForth(), config(), GOAL_TICKS)
    from pipeline.deployment.bobcat_e10_sim_driver import SimulationDriver

    return SimulationDriver(Integrator(period_s=machine.dt_s), machine.n_joint, config().driver, estimator())


if __name__ == "__main__":
    name, folder = sys.argv[1:]
    errors = None
    if name == "autonomous_server":
        from pipeline.deployment.ros1.goal_errors import goal_errors
        from tests.deployment.machines import arm

        errors = goal_errors(arm())
    node = Node(build(name), load_machine("bobcat_e10"), errors)
    node.spin()
    node.save(Path(folder) / f"{name}.json")
