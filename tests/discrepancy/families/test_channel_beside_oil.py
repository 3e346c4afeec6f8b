"""A channel that stays late while the oil warms up, told from oil whose lag ends."""

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.families.cold_oil import channel_beside
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.refine import completed, refine
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.exact_machine import DT_S, N_JOINT, SPEED, held_commands, simulation_of

N_ROWS, LOSS, COLD_LAG_S, CONSTANT_S = 7200, 0.4, 0.3, 100.0
NOISE = 0.02


def cold_log(
    latency_rows: int, constant_s: float = CONSTANT_S
) -> tuple[Simulation, ScoredRows, list[SelectedEffect]]:
    """Speeds that are slow and late when cold, read late, and the oil that a search finds of them by itself.

    Line and spool in two stages, each discretised backwards in float64.
    """
    command = held_commands(1, N_ROWS)
    given = np.vstack([np.zeros((latency_rows, N_JOINT)), command[: N_ROWS - latency_rows]])
    decay = np.exp(-DT_S * np.arange(N_ROWS) / constant_s)
    w, velocity = np.zeros((2, N_JOINT)), np.empty_like(command)
    for row in range(N_ROWS):
        to, lag_rows = SPEED * given[row], COLD_LAG_S / 2 / DT_S * decay[row]
        for stage in range(2):
            w[stage] = to = to - lag_rows / (1.0 + lag_rows) * (to - w[stage])
        velocity[row] = (1.0 - LOSS * decay[row]) * to
    velocity += NOISE * np.random.default_rng(2).standard_normal(velocity.shape)
    simulation = simulation_of(["thermal_drift", "delay"], command, velocity)
    fold = (np.arange(N_ROWS) // 400 % 2)[None]
    floor = np.full(N_JOINT, NOISE**2 / 2)  # of means over two rows
    every = np.ones((1, N_ROWS, N_JOINT), bool)
    rows = rows_in_blocks(np.ones((1, N_ROWS), bool), fold, every, floor, 400)
    oil = [c for c in screen(simulation, NOMINAL, rows) if c.family == "thermal_drift"]
    return simulation, rows, refine(simulation, rows, [SelectedEffect(completed(simulation, c)) for c in oil])


def beside(
    simulation: Simulation, rows: ScoredRows, found: list[SelectedEffect], joints: range
) -> list[Candidate]:
    """As the search asks for it."""
    comparison = Comparison(rows.folds, load_section("close_loop", CloseLoopConfig, "paper").search)
    return channel_beside(simulation, rows, found, lambda c: comparison.passes(c, is_further=True), joints)


def test_a_channel_that_stays_late_is_told_beside_the_oil() -> None:
    simulation, rows, oil = cold_log(latency_rows=3)
    late = beside(simulation, rows, oil, range(N_JOINT))
    assert [c.joint for c in late] == list(range(N_JOINT))
    assert [c.point["added_delay"] for c in late] == pytest.approx([0.15] * N_JOINT, abs=0.02)


def test_oil_alone_makes_no_channel_late() -> None:
    simulation, rows, oil = cold_log(latency_rows=0)
    assert beside(simulation, rows, oil, range(N_JOINT)) == []


def test_the_channel_is_asked_for_only_beside_oil_on_every_joint_that_moves() -> None:
    simulation, rows, oil = cold_log(latency_rows=3)
    assert beside(simulation, rows, oil[:1], range(N_JOINT)) == []
    assert beside(simulation, rows, [], range(N_JOINT)) == []
    known = beside(simulation, rows, oil, range(N_JOINT))
    assert beside(simulation, rows, [*oil, *map(SelectedEffect, known)], range(N_JOINT)) == []
