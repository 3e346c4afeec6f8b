"""Looking back at the end of the search, on joints whose speed is known exactly."""

import numpy as np

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.scored_rows import alternating_folds, rows_in_blocks
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.refine import with_gains
from pipeline.discrepancy.selection.search import Search
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.exact_machine import N_JOINT, SPEED, held_commands, simulation_of

NOISE = 0.01  # rad/s
BOTH_WAYS = ((("ratio_positive", None), ("ratio_negative", None)),)
UP = ((("mean_speed_ratio_up", None),),)


def found(family: str, joint: int, freed: tuple, change: float) -> SelectedEffect:
    return SelectedEffect(
        Candidate(family, joint, None, {}, freed, np.array([change]), 1e3, 0.9, np.ones(40))
    )


def test_what_is_superfluous_beside_others_is_dropped_and_what_explains_stays() -> None:
    command = held_commands(0, 4000)
    noise = NOISE * np.random.default_rng(1).standard_normal(command.shape)
    measured = command * SPEED * [0.7, 0.8] + noise  # both joints are slower, in both directions
    simulation = simulation_of(["gain", "load"], command, measured)
    is_used = simulation.sequences.is_row
    fold = alternating_folds(is_used, 200, 200)
    rows = rows_in_blocks(
        is_used, fold, np.ones((*is_used.shape, N_JOINT), bool), np.full(2, NOISE**2 / 2), 200
    )
    log: list[str] = []
    config = load_section("close_loop", CloseLoopConfig, "paper").search
    search = Search(simulation, rows, {}, config, (), {}, ["lift", "turn"], [0, 1], log.append)
    gains = [found("gain", joint, BOTH_WAYS, -0.2) for joint in range(2)]
    search.found = with_gains(simulation, rows, [*gains, found("load", 0, UP, 0.0)])
    search._look_back()
    kept = [(effect.candidate.family, effect.candidate.joint) for effect in search.found]
    assert kept == [("gain", 0), ("gain", 1)]
    assert log == ["load on lift is superfluous beside the others"]
