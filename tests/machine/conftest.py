"""The default machine and its arm, built once for all tests of this layer."""

from pathlib import Path

import jax
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine
from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.specification import MachineSpecification


@pytest.fixture(scope="session")
def machine_directory() -> Path:
    return MACHINE_DIRECTORY


@pytest.fixture(scope="session")
def bobcat() -> MachineSpecification:
    return load_machine("bobcat_e10")


@pytest.fixture(scope="session")
def arm(bobcat: MachineSpecification) -> Arm:
    return load_arm(bobcat, MACHINE_DIRECTORY)


@pytest.fixture(scope="session")
def forward(arm: Arm):
    return jax.jit(arm.forward)
