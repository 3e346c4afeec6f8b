from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.machine.specification import JointSpecification, MachineSpecification, WorkspaceSpecification
from pipeline.plant.bobcat_e10 import bobcat_e10
from pipeline.plant.parameters import Parameters

MACHINE_FILE = Path(__file__).parents[2] / "conf" / "machine" / "bobcat_e10.yaml"


@pytest.fixture(scope="session")
def nominal() -> Parameters:
    return bobcat_e10()


@pytest.fixture(scope="session")
def machine() -> MachineSpecification:
    values = yaml.safe_load(MACHINE_FILE.read_text())
    return MachineSpecification(
        name=values["name"],
        rate_hz=values["rate_hz"],
        joints=[JointSpecification(**joint) for joint in values["joints"]],
        workspace=WorkspaceSpecification(**values["workspace"]),
    )


def random_commands(seed: int, n_hold: int, hold: int, n_joint: int = 4) -> np.ndarray:
    """Commands that change every `hold` periods."""
    return np.repeat(np.random.default_rng(seed).integers(-1, 2, (n_hold, n_joint)), hold, axis=0)


MIDDLE = np.array([0.0, 0.75, -1.4, -0.9])
