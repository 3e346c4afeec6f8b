"""A common change of speed of known size and correlation time, beside a gain that is no part of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.acceptance.confirmation import Size
from pipeline.discrepancy.acceptance.shown import shown_on
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.families.plausibility import is_plausible
from pipeline.discrepancy.families.supply_variation import (
    FAMILY,
    supply_candidates,
    supply_parameters,
    without_common_change,
)
from pipeline.discrepancy.selection.onset import rows_since
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect

N_ROWS, N_JOINT, DT_S = 40_000, 3, 0.05
STD, TIME_S, SLOW_S, RATIO, NOISE = 0.12, 4.0, 17.0, 0.6, 0.01
STEP_NS = 50_000_000


def machine(
    seed: int,
    std: float,
    ratio: float,
    time_s: float = TIME_S,
    n_rows: int = N_ROWS,
    onset_row: int = 0,
    is_common: bool = True,
    alone_until: int = 0,
):
    """Joints that move at random, all of them by e^z as fast, the first by `ratio` as well; with encoder noise.

    From a row on; or each by a z of its own; or with the first joint moving alone until a row.
    """
    draw = np.random.default_rng(seed)
    commands = np.repeat(draw.integers(-1, 2, size=(n_rows // 20, N_JOINT)), 20, axis=0)[None].astype(float)
    commands[:, :alone_until, 1:] = 0.0
    z, decay = np.zeros((n_rows, 1 if is_common else N_JOINT)), np.exp(-DT_S / time_s)
    noise = draw.normal(size=z.shape)
    for row in range(1, n_rows):
        z[row] = decay * z[row - 1] + std * np.sqrt(1.0 - decay**2) * noise[row]
    z[:onset_row] = 0.0
    ratios = np.array([ratio, 1.0, 1.0])
    measured = commands * ratios * np.exp(z) + NOISE * draw.normal(size=commands.shape)

    def velocities(hypotheses):
        return np.stack([commands * (ratios if "gain" in h.values else 1.0) for h in hypotheses])

    simulation = SimpleNamespace(
        velocities=velocities,
        sequences=SimpleNamespace(velocity=measured, stamp_ns=STEP_NS * np.arange(n_rows)[None]),
        setting=SimpleNamespace(dt_s=DT_S),
    )
    n = n_rows // 2
    folds = Folds((np.arange(n) // 600) % 2, np.arange(n) // 200, n // 200)
    rows = ScoredRows(np.ones((1, n_rows), bool), folds, np.full(N_JOINT, NOISE**2), np.ones((n, N_JOINT)))
    return simulation, rows


@pytest.mark.parametrize("ratio", [1.0, RATIO])
def test_size_and_time_are_of_what_the_effects_beside_it_leave(ratio) -> None:
    told = supply_parameters(machine(0, STD, ratio), machine(1, 0.0, 1.0), Hypothesis({"gain": {}}))
    assert told["std_log_speed"] == pytest.approx(STD, rel=0.2)
    assert told["correlation_time"] == pytest.approx(TIME_S, rel=0.3)


def test_a_gain_that_is_not_known_is_taken_for_a_part_of_it() -> None:
    """Why the effects beside it have to be known: a test that the one above could fail."""
    told = supply_parameters(machine(0, STD, RATIO), machine(1, 0.0, 1.0), NOMINAL)
    assert told["correlation_time"] > 2.0 * TIME_S


def test_what_other_joints_show_is_taken_off_each() -> None:
    simulation, rows = machine(0, STD, RATIO)
    left = without_common_change(simulation, Hypothesis({"gain": {}}), rows, {0: 3.0, 2: 3.0})
    assert set(left) == {0, 2}
    for before, after in left.values():
        # commanded two rows of three: the change of speed beside the noise, a third of which is slower than the mean
        assert np.mean(after**2) < 0.6 * np.mean(before**2)
    nothing, rows = machine(2, 0.0, RATIO)
    (before, after), *_ = without_common_change(nothing, Hypothesis({"gain": {}}), rows, {0: 3.0}).values()
    assert np.mean(after**2) == pytest.approx(np.mean(before**2), rel=0.01)


@pytest.mark.parametrize("time_s", [2.0, 4.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_strong_supply_is_no_jitter_of_starts_though_the_shortest_time_explains_most(seed, time_s) -> None:
    simulation, rows = machine(seed, 0.3, 1.0, time_s)
    assert is_plausible(FAMILY, supply_candidates(simulation, NOMINAL, rows))


@pytest.mark.parametrize("lasting_s", [0.2, 0.4, 1.0])
def test_what_is_off_alike_at_starts_is_no_supply(lasting_s) -> None:
    simulation, rows = machine(1, 0.0, 1.0)
    of_start = np.repeat(np.random.default_rng(3).normal(0.0, 0.3, N_ROWS // 20), 20)
    during = np.arange(N_ROWS) % 20 < lasting_s / DT_S
    simulation.sequences.velocity = simulation.sequences.velocity * (1.0 + during * of_start)[:, None]
    candidates = supply_candidates(simulation, NOMINAL, rows)
    assert min(c.share for c in candidates) > 0.1
    assert not is_plausible(FAMILY, candidates)


@pytest.mark.long
def test_a_slow_supply_is_told_from_changes_that_joints_do_not_have_in_common() -> None:
    """Of 17 s in ten minutes: some thirty independent values."""
    for seed in range(3):
        assert p_of(machine(seed, STD, 1.0, SLOW_S, n_rows=12_000)) < 1e-4
    apart = [p_of(machine(seed, STD, 1.0, SLOW_S, n_rows=12_000, is_common=False)) for seed in range(20)]
    assert np.mean(np.array(apart) < 0.05) <= 0.15
    assert min(apart) > 1e-3


@pytest.mark.long
def test_a_supply_that_sets_in_is_judged_by_the_rows_after_it() -> None:
    late = []
    for seed in range(20):
        simulation, rows = machine(seed, STD, 1.0, 2.0, n_rows=12_000, is_common=False)
        late.append(p_of((simulation, rows_since(simulation, rows, 10_000 * STEP_NS)[0])))
    assert min(late) > 1e-3


def p_of(logs) -> float:
    """By the scatter between blocks alone."""
    simulation, rows = logs
    found = [SelectedEffect(c) for c in supply_candidates(simulation, NOMINAL, rows)]
    shown = shown_on(simulation, rows, found, found)
    return Size(shown.size, 0.0, shown.deviation_by_blocks(rows.folds.block)).p_value
