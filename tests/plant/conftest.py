import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.parameters import Parameters


@pytest.fixture(scope="session")
def nominal() -> Parameters:
    return bobcat_e10()


@pytest.fixture(scope="session")
def machine() -> MachineSpecification:
    return load_machine("bobcat_e10")


def random_commands(seed: int, n_hold: int, hold: int, n_joint: int = 4) -> np.ndarray:
    """Commands that change every `hold` periods."""
    return np.repeat(np.random.default_rng(seed).integers(-1, 2, (n_hold, n_joint)), hold, axis=0)


MIDDLE = np.array([0.0, 0.75, -1.4, -0.9])
