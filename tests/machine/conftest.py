"""The default machine and its arm, built once for all tests of this layer."""

from pathlib import Path

import jax
import pytest
from omegaconf import OmegaConf

from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.specification import MachineSpecification

MACHINE_DIRECTORY = Path(__file__).parents[2] / "conf" / "machine"


def load_machine(path: Path) -> MachineSpecification:
    """The specification as Hydra would build it from the file."""
    node = OmegaConf.merge(OmegaConf.structured(MachineSpecification), OmegaConf.load(path))
    machine = OmegaConf.to_object(node)
    assert isinstance(machine, MachineSpecification)
    return machine


@pytest.fixture(scope="session")
def machine_directory() -> Path:
    return MACHINE_DIRECTORY


@pytest.fixture(scope="session")
def bobcat() -> MachineSpecification:
    return load_machine(MACHINE_DIRECTORY / "bobcat_e10.yaml")


@pytest.fixture(scope="session")
def arm(bobcat: MachineSpecification) -> Arm:
    return load_arm(bobcat, MACHINE_DIRECTORY)


@pytest.fixture(scope="session")
def forward(arm: Arm):
    return jax.jit(arm.forward)
