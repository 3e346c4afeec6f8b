"""A joint that is not as it was is told, whether or not anything explains it; joints that are all off alike are not."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import hypergeom

from pipeline.discrepancy.acceptance.accept import Acceptance
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect
from pipeline.discrepancy.verdict.unexplained import excess, largest_of_all_p, unexplained
from tests.discrepancy.bare_candidate import bare_candidate

N_BLOCKS, BLOCK_ROWS, JOINTS = 40, 5, ["swing", "boom", "arm"]
ROWS = N_BLOCKS * BLOCK_ROWS


def rows() -> ScoredRows:
    folds = Folds(np.zeros(ROWS, int), np.repeat(np.arange(N_BLOCKS), BLOCK_ROWS), N_BLOCKS)
    return ScoredRows(np.ones((1, ROWS), bool), folds, np.full(3, 0.5), np.ones((ROWS, 3)))


def residual(ratio: np.ndarray, seed: int) -> np.ndarray:
    """(N, 3) whose squares scatter about (n_blocks, 3) multiples of the floor."""
    scatter = np.random.default_rng(seed).uniform(0.5, 1.5, (ROWS, 3))
    return np.sqrt(0.5 * np.repeat(ratio, BLOCK_ROWS, axis=0) * scatter)


def entries(
    fitted: np.ndarray,
    confirmed: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
    screened: Sequence[Candidate] = (),
    searched: Sequence[SelectedEffect] = (),
    borne_out: bool = False,
) -> list[dict[str, Any]]:
    parts = [
        (rows(), residual(ratio, seed))
        for seed, ratio in enumerate((np.ones((N_BLOCKS, 3)), fitted, confirmed))
    ]
    monkeypatch.setattr(
        "pipeline.discrepancy.verdict.unexplained.residual_of",
        lambda simulation, rows, _: next(residual for part, residual in parts if part is rows),
    )
    (nominal, _), (fitting, _), (held_out, _) = parts
    config = SimpleNamespace(gate=SimpleNamespace(smallest_e_value=20.0))
    machine = SimpleNamespace(joint_names=JOINTS, channel_names=())
    diagnosis: Any = SimpleNamespace(
        logs=SimpleNamespace(joints=JOINTS, config=config, machine=machine),
        nominal=SimpleNamespace(simulation=None, rows=nominal),
        simulation=None,
        rows=fitting,
        held_out=held_out,
    )
    comparison: Any = None
    selection = Selection(searched, screened, comparison, {})
    judgement: Any = SimpleNamespace(why_not=None if borne_out else "too small")
    fit: Any = None
    acceptance = Acceptance({f.candidate.key: judgement for f in searched}, fit, ())
    return unexplained(diagnosis, selection, acceptance)


def told(fitted: np.ndarray, confirmed: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    return [entry["joints"] for entry in entries(fitted, confirmed, monkeypatch)]


def raised(joints: list[int], blocks: int, by: float) -> np.ndarray:
    ratio = np.ones((N_BLOCKS, 3))
    ratio[:blocks, joints] = by
    return ratio


@pytest.mark.parametrize(
    ("fitted", "confirmed", "expected"),
    [
        (raised([1], N_BLOCKS, 5.0), raised([1], N_BLOCKS, 5.0), [["boom"]]),
        (raised([1], 12, 40.0), raised([1], 12, 40.0), [["boom"]]),  # rare, but large wherever one looks
        (raised([1], 1, 400.0), raised([1], 0, 1.0), []),  # once
        (raised([1], N_BLOCKS, 5.0), raised([1], 0, 1.0), []),  # not on the rows that nothing was searched on
        (raised([0, 1, 2], N_BLOCKS, 5.0), raised([0, 1, 2], N_BLOCKS, 5.0), []),  # jitter at all starts
        (raised([1], N_BLOCKS, 2.0), raised([1], N_BLOCKS, 2.0), []),
    ],
    ids=["always", "rarely", "once", "on one part", "on all joints", "twice the floor"],
)
def test_a_joint_that_stands_out_everywhere_is_told(
    fitted: np.ndarray, confirmed: np.ndarray, expected: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(fitted, confirmed, monkeypatch) == expected


def test_excess_is_of_the_floor_where_the_other_joints_are_below_it() -> None:
    of = excess(np.sqrt(0.5 * np.tile([0.1, 4.0, 0.3], (ROWS, 1))), rows())
    np.testing.assert_allclose(of.of_all, [0.1 / 2.15, 4.0, 0.3 / 2.05], rtol=1e-9)
    np.testing.assert_allclose(of.by_block, np.tile(of.of_all, (N_BLOCKS, 1)), rtol=1e-9)


@pytest.mark.parametrize(("n", "m", "k"), [(10, 20, 0), (10, 20, 3), (72, 144, 8), (5, 5, 5)])
def test_probability_that_the_largest_are_all_of_one_sample(n: int, m: int, k: int) -> None:
    """Of k drawn without replacement from n + m, all are of the n."""
    values = np.arange(m + n, dtype=float)[::-1]
    measured = np.concatenate([values[:k], values[k + m :]])
    assert largest_of_all_p(measured, values[k : k + m]) == pytest.approx(hypergeom(n + m, n, k).pmf(k))


def test_it_depends_on_what_the_search_came_to_though_the_gate_did_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ratio = raised([1], N_BLOCKS, 5.0)
    screened = [bare_candidate("gain", 1), bare_candidate("other:rest_time", 1)]
    course, scale = "other:absolute_time", "sensor_bias"
    for found, borne_out, expected in (
        ([], False, ["rest_time:boom"]),
        ([SelectedEffect(bare_candidate(course, 1))], False, ["absolute_time"]),
        ([SelectedEffect(bare_candidate(course, 0))], False, ["rest_time:boom"]),
        ([SelectedEffect(bare_candidate(scale, 1))], True, ["position:boom"]),
        ([SelectedEffect(bare_candidate(scale, 1))], False, ["rest_time:boom"]),
        (
            [SelectedEffect(bare_candidate(scale, 1)), SelectedEffect(bare_candidate(course, 1))],
            True,
            ["absolute_time"],
        ),
    ):
        (entry,) = entries(ratio, ratio, monkeypatch, screened, found, borne_out)
        assert (entry["depends_on"], entry["certain"]) == (expected, False)


def test_what_a_known_effect_leaves_of_its_joint_is_not_new(monkeypatch: pytest.MonkeyPatch) -> None:
    off, gain = raised([1], N_BLOCKS, 5.0), bare_candidate("gain", 1)
    assert entries(off, off, monkeypatch, searched=[SelectedEffect(gain)])
    assert entries(off, off, monkeypatch, searched=[SelectedEffect(gain, known=Known(gain))]) == []
