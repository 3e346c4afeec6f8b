"""The moment at which an effect sets in, on a joint whose speed is scaled from some row on."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED, ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.onset import with_onsets
from pipeline.discrepancy.selection.regression import Folds
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain

N_ROWS, BLOCK_ROWS, NOISE, RATIO = 4000, 200, 0.05, 0.7
STEP_NS = 50_000_000


def with_onset(first_row: int) -> Candidate:
    """A gain, as fitted without an onset, of a joint that has it from this row on."""
    random = np.random.default_rng(1)
    u = np.repeat(random.standard_normal((1, N_ROWS // ROWS_AVERAGED, 1)), ROWS_AVERAGED, axis=1)
    ratio = np.where(np.arange(N_ROWS) >= first_row, RATIO, 1.0)[:, None]
    velocity = ratio * u + NOISE * random.standard_normal(u.shape)

    def velocities(hypotheses: list[Hypothesis]) -> np.ndarray:
        return np.stack([u * h.values["gain"]["ratio_positive"] if h.values else u for h in hypotheses])

    sequences = SimpleNamespace(velocity=velocity, stamp_ns=STEP_NS * np.arange(N_ROWS)[None])
    effects = {"gain": Gain(Setting(0.05, -np.ones(1), np.ones(1), np.ones(1)))}
    simulation = SimpleNamespace(sequences=sequences, velocities=velocities, effects=effects)
    n = N_ROWS // ROWS_AVERAGED
    block = np.arange(n) // (BLOCK_ROWS // ROWS_AVERAGED)
    rows = ScoredRows(
        np.ones((1, N_ROWS), bool), Folds(block % 2, block, 20), np.full(1, NOISE**2), np.ones((n, 1))
    )
    freed = ((("ratio_positive", None), ("ratio_negative", None)),)
    mean = (RATIO - 1.0) * (1.0 - first_row / N_ROWS)
    before = rows.averaged(velocity - u)
    gain = float(np.sum(before**2 - (before - mean * rows.averaged(u)) ** 2)) / NOISE**2
    blocks = np.full(20, gain / 20)
    candidate = Candidate("gain", 0, None, {}, freed, np.array([mean]), gain, 0.5, blocks)
    return with_onsets(simulation, NOMINAL, rows, [candidate])[0]


def test_the_moment_is_found() -> None:
    found = with_onset(1600)
    assert found.onset == pytest.approx(1600 * STEP_NS, abs=40 * STEP_NS)
    assert found.coefficients[0] == pytest.approx(RATIO - 1.0, abs=0.02)


def test_two_blocks_before_a_moment_are_too_few_to_say_that_it_was_not_there() -> None:
    assert with_onset(0).onset is None
    assert with_onset(2 * BLOCK_ROWS).onset is None
    assert with_onset(4 * BLOCK_ROWS).onset is not None
