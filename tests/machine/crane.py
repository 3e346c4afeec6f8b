"""A machine unlike the default one: three joints out of order, one of which may slide; continuous commands."""

import dataclasses

import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.machine.chain import FIXED, ChainJoint
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import CommandKind, JointKind, JointSpecification, MachineSpecification


def crane(reach: JointKind = JointKind.prismatic) -> tuple[MachineSpecification, Arm]:
    """The joint `reach` is on a slanted axis behind a fixed link."""
    bobcat = load_machine("bobcat_e10")
    assert bobcat.arm is not None
    machine = dataclasses.replace(
        bobcat,
        name="crane",
        command_kind=CommandKind.continuous,
        joints=[
            JointSpecification("reach", 0.1, 1.4, reach),
            JointSpecification("slew", -2.0, 2.0),
            JointSpecification("tilt", -1.0, 0.7),
        ],
        arm=dataclasses.replace(bobcat.arm, yaw_joint="slew", pitch_joints=["tilt"]),
    )
    half = np.sqrt(0.5)
    chain = [
        ChainJoint(
            "slew", "revolute", "a", "b", (0.0, 0.1, 0.5), (half, 0.0, half, 0.0), (0.0, 0.6, 0.8), (0, 0)
        ),
        ChainJoint("mount", FIXED, "b", "c", (0.2, 0.0, 0.1), (0.5, -0.5, 0.5, 0.5), (1.0, 0.0, 0.0), (0, 0)),
        ChainJoint(
            "reach", reach.value, "c", "d", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.8, 0.0, -0.6), (0, 0)
        ),
        ChainJoint(
            "tilt", "revolute", "d", "e", (0.4, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0, 0)
        ),
    ]
    return machine, Arm(machine, chain)
