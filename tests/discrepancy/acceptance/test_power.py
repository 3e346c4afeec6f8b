"""A size that is told as visible is found in nine of ten logs, half of it is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.power import visible_sizes
from pipeline.discrepancy.diagnosis.scored_rows import rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.exact_machine import N_JOINT, SPEED, held_commands, simulation_of

N_ROWS, NOISE = 4800, 0.1
SETTINGS = load_section("close_loop", CloseLoopConfig, "paper")


def logs(seed: int, loss: float = 0.0) -> Simulation:
    """Of which the first joint has lost a share of its speed."""
    random = np.random.default_rng(seed)
    command = held_commands(seed, N_ROWS)
    velocity = SPEED * command * np.array([1.0 - loss, 1.0]) + NOISE * random.standard_normal(command.shape)
    return simulation_of(["gain"], command, velocity)


ROWS = rows_in_blocks(
    np.ones((1, N_ROWS), bool),
    (np.arange(N_ROWS) // 400 % 2)[None],
    np.ones((1, N_ROWS, N_JOINT), bool),
    np.full(N_JOINT, NOISE**2 / 2),
    200,
)


@pytest.fixture(scope="module")
def visible() -> dict[int, Any]:
    """By joint; the second one does not move enough."""
    nominal = SimpleNamespace(simulation=logs(1), rows=ROWS, at_rest=(), null={}, present=())
    diagnosis: Any = SimpleNamespace(
        logs=SimpleNamespace(config=SETTINGS, is_of_one_machine=False),
        nominal=nominal,
        simulation=logs(2),
        rows=ROWS,
        held_out=ROWS,
        excited=[0],
    )
    return {of.joint: of for of in visible_sizes(FittedEffects(diagnosis, [], []))}


def is_found(seed: int, loss: float) -> bool:
    """By the screen."""
    candidate = max(
        (c for c in screen(logs(seed, loss), NOMINAL, ROWS) if c.joint == 0), key=lambda c: c.gain
    )
    return Comparison(ROWS.folds, SETTINGS.search).passes(candidate)


def test_told_sizes_are_found(visible) -> None:
    size = visible[0].size
    assert visible[0].unit == "1"
    assert sum(is_found(seed, size) for seed in range(10, 30)) >= 16
    assert sum(is_found(seed, 0.5 * size) for seed in range(10, 30)) <= 10


def test_of_a_joint_that_hardly_moves_nothing_is_visible(visible) -> None:
    assert visible[1].size == np.inf
