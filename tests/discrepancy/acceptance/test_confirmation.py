"""What confirmation rows say of effects on several joints: together, alone, and of what nobody may shift."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.acceptance.confirmation import Confirmation, Confirmed, in_words
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.effects.effect import Setting
from pipeline.effects.flow_coupling import FlowCoupling

N_ROWS, BLOCK_ROWS, NOISE = 4000, 50, 0.05
GATE = load_section("close_loop", CloseLoopConfig, "paper").gate
EFFECTS = {"flow_coupling": FlowCoupling(Setting(0.05, -np.ones(2), np.ones(2), np.ones(2)))}


def confirmation(
    true_loss: tuple[float, float],
    scale: tuple[float, float] = (1.0, 1.0),
    since: int = 0,
    part_rows: int = N_ROWS // 2,
) -> Confirmation:
    """Two joints that move at random and lose these shares of their speed from a row on; every second part held out."""
    random = np.random.default_rng(0)
    u = random.standard_normal((1, N_ROWS, 2)) * scale
    stamps = np.arange(N_ROWS)[None]
    acts = (stamps >= since)[..., None]
    velocity = u * (1.0 - acts * np.array(true_loss)) + NOISE * np.array(scale) * random.standard_normal(
        u.shape
    )

    def velocities(hypotheses: list[Hypothesis]) -> np.ndarray:
        under = []
        for h in hypotheses:
            loss = h.values["flow_coupling"]["loss_fraction"].sum(axis=1) if h.values else np.zeros(2)
            onsets = [h.onsets.get(("flow_coupling", joint), 0) for joint in (0, 1)]
            under.append(u * (1.0 - (stamps[..., None] >= np.array(onsets)) * loss))
        return np.stack(under)

    sequences = SimpleNamespace(velocity=velocity, stamp_ns=stamps)
    simulation = SimpleNamespace(sequences=sequences, velocities=velocities, effects=EFFECTS)
    late = stamps // part_rows % 2 == 1
    return Confirmation(simulation, rows(~late), rows(late), {}, GATE, 100, (0, 1), 2, 0)


def rows(is_used: np.ndarray) -> ScoredRows:
    n = int(is_used.sum()) // 2
    block = np.arange(n) // BLOCK_ROWS
    return ScoredRows(
        is_used, Folds(block % 2, block, int(block.max()) + 1), np.full(2, NOISE**2), np.ones((n, 2))
    )


def coupled(joint: int, loss: float) -> SelectedEffect:
    """A joint that loses a share of its speed by the other one, as fitted."""
    freed = ((("loss_fraction", 1 - joint),),)
    return SelectedEffect(
        Candidate("flow_coupling", joint, None, {}, freed, np.array([loss]), 1.0, 0.5, np.ones(4))
    )


def test_one_cause_is_left_off_the_joint_on_which_it_is_no_help() -> None:
    first, second = confirmation((0.2, 0.0)).judge([coupled(0, 0.2), coupled(1, 0.1)])
    assert first.is_confirmed and first.bound > 0.5
    assert not first.is_pooled  # by itself it shows more than with a joint that has no part in it
    assert not second.is_confirmed and second.share < 0.0


def test_joints_bear_each_other_out_and_count_alike_whatever_their_size() -> None:
    # by itself the second joint's lower bound would be below zero
    gate = replace(GATE, smallest_improvement=0.05)
    judging = replace(confirmation((0.3, 0.012), scale=(1.0, 100.0)), config=gate)
    alone = judging.judge([coupled(1, 0.012)])[0]
    together = judging.judge([coupled(0, 0.3), coupled(1, 0.012)])[1]
    assert 0.0 < alone.share < 0.1 and not alone.is_confirmed
    assert together.is_confirmed and together.is_pooled and together.share == pytest.approx(alone.share)
    assert together.bound > alone.bound


def test_once_a_cause_has_passed_joints_are_asked_whether_they_have_part_in_it_not_for_the_catalogue() -> (
    None
):
    judging = confirmation((0.3, 0.03))
    first, second = coupled(0, 0.3), coupled(1, 0.03)
    strong, weak = (replace(judging, n_hypotheses=1).judge([one])[0].p_value for one in (first, second))
    assert strong < 1e-3 * weak
    judging = replace(
        judging, n_hypotheses=round(10.0 * GATE.largest_p / weak)
    )  # too many for the second by itself
    alone = judging.judge([second])[0]
    assert alone.p_value == pytest.approx(10.0 * GATE.largest_p, rel=0.1) and not alone.is_confirmed
    _, together = judging.judge([first, second])
    assert together.is_pooled and together.is_confirmed
    assert together.p_value == pytest.approx(2.0 * weak, rel=0.2)  # of two joints


def setting_in(loss: float, onset: int | None, between: tuple[int, int] | None = None) -> SelectedEffect:
    found = coupled(0, loss)
    return replace(found, candidate=replace(found.candidate, onset=onset, onset_between=between))


def test_what_sets_in_is_judged_from_its_moment_on() -> None:
    judging = confirmation((0.3, 0.0), since=2500, part_rows=200)
    right, always = (judging.judge([setting_in(0.3, onset)])[0] for onset in (2500, None))
    assert right.is_confirmed
    assert always.share < 0.0 and not always.is_confirmed


def test_rows_that_may_lie_on_either_side_of_an_onset_count_for_nothing() -> None:
    between = (2000, 3000)
    early, late = (
        confirmation((0.3, 0.0), since=since, part_rows=200).judge([setting_in(0.3, 2400, between)])[0]
        for since in between
    )
    exact = confirmation((0.3, 0.0), since=2400, part_rows=200).judge([setting_in(0.3, 2400)])[0]
    assert early.is_confirmed and late.is_confirmed
    assert early.share == pytest.approx(late.share, abs=1e-12)
    assert early.share == pytest.approx(exact.share, abs=0.03)


def test_a_bound_of_more_confidence_is_lower() -> None:
    judging = confirmation((0.03, 0.0))
    bounds = [
        replace(judging, config=replace(GATE, confidence=c)).judge([coupled(0, 0.03)])[0].bound
        for c in (0.8, 0.95)
    ]
    assert bounds[0] > bounds[1]


def test_the_sentence_says_whose_bound_it_is() -> None:
    judgement = Confirmed(0.3, 0.2, 1e-9, is_confirmed=True, is_pooled=False)
    assert "(at least 20%)" in in_words(coupled(0, 0.1), judgement, "lift")
    pooled = replace(judgement, is_pooled=True, is_confirmed=False)
    assert "not confirmed" in in_words(coupled(0, 0.1), pooled, "lift")
    assert "(with its other joints at least 20%)" in in_words(coupled(0, 0.1), pooled, "lift")
    local = replace(judgement, bound=0.9, is_local=True)
    assert "it removes 30% of the squared residual (where it acts at least 90%)" in in_words(
        coupled(0, 0.1), local, "lift"
    )


@pytest.mark.parametrize(("loss_by_turns", "is_confirmed"), [((0.0, 0.4), True), ((0.2, 0.2), False)])
def test_a_course_in_time_has_to_explain_more_than_a_constant(loss_by_turns, is_confirmed) -> None:
    judged = confirmation((0.0, 0.0))
    simulation = judged.simulation
    simulation.setting = SimpleNamespace(dt_s=0.05, n_joint=2)
    is_second = np.arange(N_ROWS) // 400 % 2
    u = simulation.velocities([NOMINAL])[0]
    simulation.sequences.velocity[..., 0] -= np.array(loss_by_turns)[is_second] * u[..., 0]
    course = SelectedEffect(
        Candidate("other:absolute_time", 0, None, {"width": 3.0}, (), np.ones(1), 1.0, 0.5, np.ones(4))
    )
    seen = judged.judge([course])[0]
    assert seen.is_confirmed is is_confirmed
    assert seen.bound <= seen.share
    assert (seen.share > 0.5) is is_confirmed
