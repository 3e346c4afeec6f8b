import dataclasses

import jax.numpy as jnp
import pytest

from pipeline.configuration.load import load_section
from pipeline.control.icem.config import IcemConfig


class Quadratic:
    """Returns that can be computed by hand: minus the squared distance of a sequence to the one that is the state."""

    def __call__(self, state, commands):
        return -jnp.sum((commands - state) ** 2, axis=(1, 2))


@pytest.fixture(scope="session")
def small_icem() -> IcemConfig:
    """The paper's ingredients with a small budget: 30, 24 and 19 samples, 8 elites, of which 4 are reused."""
    paper = load_section("icem", IcemConfig)
    return dataclasses.replace(paper, horizon=5, samples=30, elites=8, iterations=3)
