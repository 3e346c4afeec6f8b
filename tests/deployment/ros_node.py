"""One node of the tests' real graph: `python -m tests.deployment.ros_node NAME FOLDER PORT [supervised|all_rules]`.

What a node does not need is not imported: each one is a process of its own.
"""

import dataclasses
import sys
from pathlib import Path

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import Component, nanoseconds
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.ros1.can_bus import CanBusConfig, open_bus
from pipeline.deployment.transports.ros1.node import Node

NODES = ("control_interface", "control_supervisor", "autonomous_server")
SIMULATED = ("bobcat_e10_sim_driver",)
CAN = ("plc", "emcb_200u_driver", "bobcat_e10_driver")  # the machine's own drivers, and a PLC
GOAL_TICKS, LONG_GOAL_TICKS = 30, 200
SUPERVISED, ALL_RULES = "supervised", "all_rules"
OF_TIME = ("command_frequency", "command_delay", "state_frequency")


def bus_config(port: int) -> CanBusConfig:
    return CanBusConfig("udp_multicast", "239.74.163.2", {"port": port, "hop_limit": 0})


def config(rules: str = "") -> DeploymentConfig:
    """One rule is on, which does not depend on how busy this computer is; or all that do not; or all.

    The interface then waits for the supervisor as long as the PLC for frames.
    """
    default = load_section("deployment", DeploymentConfig, "default")
    active = {
        ALL_RULES: default.supervisor.rules,
        SUPERVISED: [name for name in default.supervisor.rules if name not in OF_TIME],
        "": ["command_value"],
    }
    supervisor = dataclasses.replace(default.supervisor, rules=active[rules])
    silence_s = default.driver.command_timeout_s
    interface = dataclasses.replace(
        default.interface, supervised=bool(rules), maximum_supervisor_silence_s=silence_s
    )
    return dataclasses.replace(default, supervisor=supervisor, interface=interface)


def build(name: str, port: int, rules: str = "") -> Component:
    machine, settings = load_machine("bobcat_e10"), config(rules)
    if name == "control_interface":
        from pipeline.deployment.components.control_interface import ControlInterface

        return ControlInterface(machine, settings.interface)
    if name == "control_supervisor":
        from pipeline.deployment.components.supervision.control_supervisor import supervise

        return supervise(machine, settings, MACHINE_DIRECTORY)
    if name == "emcb_200u_driver":
        from pipeline.deployment.drivers.emcb_200u_driver import CanDriver

        return CanDriver(open_bus(bus_config(port)), settings.driver)
    from pipeline.deployment.drivers.can_frames import CanFrames

    if name == "bobcat_e10_driver":
        from pipeline.deployment.components.velocity_estimator import VelocityEstimator
        from pipeline.deployment.drivers.bobcat_e10_driver import MachineDriver
        from pipeline.logs.loop_tracker import LoopTrackerConfig

        tracker = VelocityEstimator(nanoseconds(machine.dt_s), LoopTrackerConfig(10.0, 60.0))
        return MachineDriver(machine, CanFrames(machine, MACHINE_DIRECTORY), tracker)
    from tests.deployment.machines import BackAndForth, Integrator, estimator, server

    if name == "autonomous_server":
        return server(BackAndForth(), LONG_GOAL_TICKS if rules else GOAL_TICKS)
    moving = Integrator(period_s=machine.dt_s)
    if name == "plc":
        from pipeline.deployment.transports.ros1.observed_plc import ObservedPlc

        frames = CanFrames(machine, MACHINE_DIRECTORY)
        return ObservedPlc(open_bus(bus_config(port)), frames, moving, machine.n_joint, settings.driver)
    from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver

    return SimulationDriver(moving, machine.n_joint, settings.driver, estimator())


if __name__ == "__main__":
    name, folder, port, *rules = sys.argv[1:]
    errors = None
    if name == "autonomous_server":
        from pipeline.deployment.transports.ros1.goal_errors import goal_errors
        from tests.deployment.machines import arm

        errors = goal_errors(arm())
    node = Node(build(name, int(port), *rules), load_machine("bobcat_e10"), errors)
    node.spin()
    node.save(Path(folder) / f"{name}.json")
