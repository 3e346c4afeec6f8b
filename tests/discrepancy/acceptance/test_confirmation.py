"""What confirmation rows say of effects on several joints, of onsets, and of what varies in time."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.acceptance.confirmation import Confirmed, confirm, in_words
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects, grouped
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.effect import Setting
from pipeline.effects.flow_coupling import FlowCoupling

N_ROWS, BLOCK_ROWS, NOISE, SMALLEST_E_VALUE = 4000, 50, 0.05, 20.0
EFFECTS = {"flow_coupling": FlowCoupling(Setting(0.05, -np.ones(2), np.ones(2), np.ones(2)))}


def machine(seed: int, loss: Any, scale: tuple[float, float] = (1.0, 1.0), since: int = 0) -> Any:
    """Two joints that move at random and lose a share of their speed, of each or of each row, from a row on."""
    random = np.random.default_rng(seed)
    u = random.standard_normal((1, N_ROWS, 2)) * scale
    stamps = np.arange(N_ROWS)[None]
    acts = (stamps >= since)[..., None]
    velocity = u * (1.0 - acts * np.asarray(loss)) + NOISE * np.array(scale) * random.standard_normal(u.shape)

    def velocities(hypotheses: list[Hypothesis]) -> np.ndarray:
        under = []
        for h in hypotheses:
            lost = h.values["flow_coupling"]["loss_fraction"].sum(axis=1) if h.values else np.zeros(2)
            onsets = [h.onsets.get(("flow_coupling", joint), 0) for joint in (0, 1)]
            under.append(u * (1.0 - (stamps[..., None] >= np.array(onsets)) * lost))
        return np.stack(under)

    sequences = SimpleNamespace(velocity=velocity, stamp_ns=stamps)
    setting = SimpleNamespace(dt_s=0.05, n_joint=2)
    return SimpleNamespace(sequences=sequences, velocities=velocities, effects=EFFECTS, setting=setting)


def rows(is_used: np.ndarray, scale: tuple[float, float] = (1.0, 1.0)) -> ScoredRows:
    n = int(is_used.sum()) // 2
    block = np.arange(n) // BLOCK_ROWS
    return ScoredRows(
        is_used,
        Folds(block % 2, block, int(block.max()) + 1),
        (NOISE * np.array(scale)) ** 2,
        np.ones((n, 2)),
    )


def judged(
    measured: Any,
    found: list[SelectedEffect],
    nominal: Any = None,
    scale: tuple[float, float] = (1.0, 1.0),
    part_rows: int = N_ROWS // 2,
    present: tuple[str, ...] = (),
) -> list[Confirmed]:
    """Every second part of the measured rows is held out; nominal logs lose no speed, if they are not given."""
    late = np.arange(N_ROWS)[None] // part_rows % 2 == 1
    usual = machine(1, np.zeros(2), scale) if nominal is None else nominal
    diagnosis: Any = SimpleNamespace(
        simulation=measured,
        rows=rows(~late, scale),
        held_out=rows(late, scale),
        excited=(0, 1),
        nominal=SimpleNamespace(
            simulation=usual, rows=rows(np.ones((1, N_ROWS), bool), scale), present=present
        ),
        logs=SimpleNamespace(
            joints=["turn", "lift"], is_of_one_machine=False, config=SimpleNamespace(exclude=())
        ),
    )
    fit: FittedEffects = grouped(diagnosis, found)
    by_key = {
        key: of for effect in fit.effects for key, of in confirm(fit, effect, {}, SMALLEST_E_VALUE).items()
    }
    return [by_key[f.candidate.key] for f in found]


def coupled(joint: int, loss: float) -> SelectedEffect:
    """A joint that loses a share of its speed by the other one, as fitted."""
    freed = ((("loss_fraction", 1 - joint),),)
    return SelectedEffect(
        Candidate("flow_coupling", joint, None, {}, freed, np.array([loss]), 1.0, 0.5, np.ones(4))
    )


def test_an_effect_that_is_there_passes_with_its_size() -> None:
    (of,) = judged(machine(0, (0.2, 0.0)), [coupled(0, 0.25)])
    assert of.why_not is None and of.size is not None
    assert of.size.value == pytest.approx(0.8, abs=0.02)
    assert of.share > 0.85


def test_one_cause_is_left_off_the_joint_on_which_it_is_no_help() -> None:
    first, second = judged(machine(0, (0.2, 0.0)), [coupled(0, 0.2), coupled(1, 0.1)])
    assert first.why_not is None
    assert second.why_not is not None and second.share < 0.0
    assert first.e_value == second.e_value  # of the cause


def test_joints_count_alike_whatever_their_size() -> None:
    scale = (1.0, 100.0)
    found = [coupled(0, 0.3), coupled(1, 0.06)]
    small, large = (judged(machine(0, (0.3, 0.06), of), found, scale=of) for of in ((1.0, 1.0), scale))
    for one, other in zip(small, large, strict=True):
        assert one.e_value == pytest.approx(other.e_value) and one.why_not is None


@pytest.mark.parametrize(("of_nominal", "passes"), [(0.0, True), (0.01, True), (0.06, False), (0.1, False)])
def test_what_nominal_logs_ask_for_by_turns_is_no_effect(of_nominal: float, passes: bool) -> None:
    """Nominal logs of which some lose speed as measured ones do: misfit of the model, not a change of the machine."""
    by_turns = of_nominal * np.where(np.arange(N_ROWS) // 1000 % 2, 1.0, -1.0)[:, None] * np.array([1.0, 0.0])
    (of,) = judged(machine(0, (0.1, 0.0)), [coupled(0, 0.1)], machine(1, by_turns))
    assert (of.why_not is None) is passes


@pytest.mark.parametrize(("of_nominal", "passes"), [(0.03, True), (0.1, False)])
def test_what_all_nominal_logs_ask_for_is_taken_off(of_nominal: float, passes: bool) -> None:
    """A model that lacks the same all the time does not hide that measured logs have three times as much."""
    (of,) = judged(machine(0, (0.1, 0.0)), [coupled(0, 0.1)], machine(1, (of_nominal, 0.0)))
    assert (of.why_not is None) is passes
    assert of.size is not None and of.size.usual == pytest.approx(of_nominal / 0.1, abs=0.02)


def test_nominal_logs_that_were_found_to_show_it_are_no_evidence_against_it() -> None:
    measured, nominal = machine(0, (0.1, 0.0)), machine(1, (0.1, 0.0))
    (refused,), (passed,) = (
        judged(measured, [coupled(0, 0.1)], nominal, present=of) for of in ((), ("flow_coupling",))
    )
    assert refused.why_not is not None and passed.why_not is None


def test_of_misfit_alone_at_most_one_in_twenty_passes() -> None:
    """Machines whose sessions differ by chance, the measured one as the nominal ones do."""
    passed = 0
    for seed in range(60):
        sizes = np.random.default_rng(seed).normal(0.0, 0.1, 13)
        of_nominal = np.repeat(sizes[1:], N_ROWS // 12 + 1)[:N_ROWS, None] * np.array([1.0, 0.0])
        measured, nominal = machine(2 * seed, (sizes[0], 0.0)), machine(2 * seed + 1, of_nominal)
        passed += judged(measured, [coupled(0, sizes[0])], nominal)[0].why_not is None
    assert passed <= 3


def setting_in(loss: float, onset: int | None, between: tuple[int, int] | None = None) -> SelectedEffect:
    found = coupled(0, loss)
    return replace(found, candidate=replace(found.candidate, onset=onset, onset_between=between))


def test_what_sets_in_is_judged_from_its_moment_on() -> None:
    measured = machine(0, (0.3, 0.0), since=2500)
    right, always = (judged(measured, [setting_in(0.3, onset)], part_rows=200)[0] for onset in (2500, None))
    assert right.why_not is None and right.share > 0.9
    assert always.share < 0.0


def test_rows_that_may_lie_on_either_side_of_an_onset_count_for_nothing() -> None:
    between = (2000, 3000)
    early, late = (
        judged(machine(0, (0.3, 0.0), since=since), [setting_in(0.3, 2400, between)], part_rows=200)[0]
        for since in between
    )
    exact = judged(machine(0, (0.3, 0.0), since=2400), [setting_in(0.3, 2400)], part_rows=200)[0]
    assert early.why_not is None and late.why_not is None
    assert early.share == pytest.approx(late.share, abs=1e-12)
    assert early.share == pytest.approx(exact.share, abs=0.03)


def test_the_sentence_says_what_was_asked_for() -> None:
    (of,) = judged(machine(0, (0.1, 0.0)), [coupled(0, 0.1)])
    assert "flow_coupling on lift is confirmed" in in_words(coupled(0, 0.1), of, "lift")
    refused = replace(of, why_not="its e-value is 3")
    assert "is not confirmed, as its e-value is 3" in in_words(coupled(0, 0.1), refused, "lift")
    assert "the stops" in in_words(coupled(0, 0.1), replace(of, size=None), "lift")


@pytest.mark.parametrize(("loss_by_turns", "passes"), [((0.0, 0.4), True), ((0.2, 0.2), False)])
def test_a_course_in_time_has_to_explain_more_than_a_constant(
    loss_by_turns: tuple[float, float], passes: bool
) -> None:
    is_second = np.arange(N_ROWS) // 400 % 2
    by_row = np.array(loss_by_turns)[is_second][:, None] * np.array([1.0, 0.0])
    course = SelectedEffect(
        Candidate("other:absolute_time", 0, None, {"width": 3.0}, (), np.ones(1), 1.0, 0.5, np.ones(4))
    )
    (seen,) = judged(machine(0, by_row), [course])
    assert (seen.why_not is None) is passes
    assert (seen.share > 0.5) is passes
