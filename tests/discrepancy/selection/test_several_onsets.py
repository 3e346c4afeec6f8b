"""Velocities of a machine that changes more than once: each effect acts from its own moment on, joint by joint."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.discrepancy.correction.corrected_models import active_effects
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.onset import of_one_moment
from pipeline.discrepancy.selection.refine import refine
from pipeline.discrepancy.selection.selected_effect import (
    SelectedEffect,
    hypothesis_of,
    onsets_of,
    velocity_of,
)
from tests.discrepancy.bare_candidate import bare_candidate
from tests.discrepancy.exact_machine import N_JOINT, SETTING, SPEED, STEP_NS, held_commands, simulation_of

N_ROWS, EARLY, LATE = 600, 200, 430
COMMAND = held_commands(3, N_ROWS)
RATIO, SAG = 0.7, -0.05
BOTH_WAYS = ((("ratio_positive", None), ("ratio_negative", None)),)


def gain(joint: int, onset_row: int | None, ratio: float = RATIO) -> Candidate:
    return replace(
        bare_candidate("gain", joint),
        freed=BOTH_WAYS,
        coefficients=np.array([ratio - 1.0]),
        onset=at(onset_row),
    )


def leakage(joint: int, onset_row: int | None) -> Candidate:
    return replace(
        bare_candidate("leakage", joint),
        freed=((("sag_rate", None),),),
        coefficients=np.array([SAG]),
        onset=at(onset_row),
    )


def at(row: int | None) -> int | None:
    return None if row is None else STEP_NS * row


def measured(joint: int, slow_from: int, sags_from: int = N_ROWS) -> np.ndarray:
    """(T,) written out: slower from one row on, creeping while at rest from another on."""
    row, command = np.arange(N_ROWS), COMMAND[:, joint]
    speed = np.where(row >= slow_from, RATIO, 1.0) * SPEED[joint] * command
    return speed + np.where((row >= sags_from) & (command == 0.0), SAG, 0.0)


def rows_of_all() -> ScoredRows:
    is_used = np.ones((1, N_ROWS), bool)
    is_known = np.ones((1, N_ROWS, N_JOINT), bool)
    return rows_in_blocks(is_used, is_used * 0, is_known, np.full(N_JOINT, 1e-4), 100)


def simulation() -> Simulation:
    return simulation_of(["gain", "leakage"], COMMAND, SPEED * COMMAND)


@pytest.mark.parametrize(("first", "second"), [(EARLY, LATE), (LATE, EARLY), (EARLY, None), (None, LATE)])
def test_the_same_effect_sets_in_on_each_joint_at_its_moment(first: int | None, second: int | None) -> None:
    found = [SelectedEffect(gain(0, first)), SelectedEffect(gain(1, second))]
    expected = np.stack([measured(0, first or 0), measured(1, second or 0)], axis=1)
    np.testing.assert_allclose(velocity_of(simulation(), found)[0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("slow", "sags"), [(EARLY, LATE), (LATE, EARLY), (EARLY, EARLY), (EARLY, None), (None, LATE)]
)
def test_two_effects_set_in_on_one_joint_each_at_its_moment(slow: int | None, sags: int | None) -> None:
    found = [SelectedEffect(gain(0, slow)), SelectedEffect(leakage(0, sags)), SelectedEffect(gain(1, LATE))]
    expected = np.stack([measured(0, slow or 0, sags or 0), measured(1, LATE)], axis=1)
    np.testing.assert_allclose(velocity_of(simulation(), found)[0], expected, atol=1e-6)


def test_each_is_fitted_on_the_rows_that_it_acts_on() -> None:
    """Two onsets on a joint, none on the other."""
    machine = simulation_of(
        ["gain", "leakage"], COMMAND, np.stack([measured(0, EARLY, LATE), measured(1, 0)], axis=1)
    )
    start = [
        SelectedEffect(gain(0, EARLY, 0.9)),
        SelectedEffect(leakage(0, LATE)),
        SelectedEffect(gain(1, None, 0.9)),
    ]
    fitted = [of.candidate.coefficients for of in refine(machine, rows_of_all(), start)]
    np.testing.assert_allclose(np.concatenate(fitted), [RATIO - 1.0, SAG, RATIO - 1.0], atol=1e-3)


@pytest.mark.parametrize("true", [EARLY, None])
@pytest.mark.parametrize("joint", [0, 1])
def test_one_cause_sets_in_on_all_its_joints_at_the_moment_that_suits_them_best(
    true: int | None, joint: int
) -> None:
    """The search saw the moment on one joint alone."""
    machine = simulation_of(
        ["gain", "leakage"], COMMAND, np.stack([measured(0, true or 0), measured(1, true or 0)], axis=1)
    )
    told = [SelectedEffect(gain(0, EARLY)), SelectedEffect(gain(1, None))][:: 1 - 2 * joint]
    beside = SelectedEffect(leakage(1, LATE))  # of one joint alone: it keeps its own
    found = of_one_moment(machine, rows_of_all(), [*told, beside], ["gain", "leakage"])
    assert [f.candidate.onset for f in found] == [at(true), at(true), at(LATE)]
    np.testing.assert_allclose([f.candidate.coefficients[0] for f in found[:2]], RATIO - 1.0, atol=1e-3)


def test_what_sets_in_is_not_blamed_for_having_nothing_to_gain_before() -> None:
    by_block = np.array([0.0, 0.0, 0.0, 0.0, 3.0, 5.0, 3.0, 5.0])
    always = replace(gain(0, None), gain_by_block=by_block)
    assert replace(always, onset=at(EARLY)).t == pytest.approx(16.0 / (2.0 * np.sqrt(4.0 / 3.0)))
    assert always.t < 3.0
    few = replace(always, gain_by_block=by_block[:-1])
    assert replace(few, onset=at(EARLY)).t == few.t  # three blocks do not tell their scatter


def test_what_has_set_in_is_not_taken_back_from_velocities_that_are_known() -> None:
    """An effect beside others acts on the velocities in their presence, all the time."""
    machine, found = simulation(), [SelectedEffect(gain(0, EARLY)), SelectedEffect(leakage(0, LATE))]
    known = np.moveaxis(velocity_of(machine, found), 1, 0)
    beside = replace(hypothesis_of(machine, [SelectedEffect(gain(0, None, 0.5))]), onsets=onsets_of(found))
    np.testing.assert_allclose(
        machine.velocities([beside], known)[0, 0, :, 0], 0.5 * measured(0, EARLY, LATE), atol=1e-6
    )


@pytest.mark.parametrize(("onsets", "n_runs"), [([None, None], 1), ([EARLY, EARLY], 2), ([EARLY, LATE], 3)])
def test_moments_cost_a_run_each(
    onsets: list[int | None], n_runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, runs = simulation(), []
    present = machine._present
    monkeypatch.setattr(machine, "_present", lambda *arguments: runs.append(1) or present(*arguments))
    velocity_of(machine, [SelectedEffect(gain(joint, onset)) for joint, onset in enumerate(onsets)])
    assert len(runs) == n_runs


def test_the_model_afterwards_has_each_joints_own_onset() -> None:
    machine = simulation()
    effects = [
        MachineEffect("gain", [SelectedEffect(gain(0, EARLY)), SelectedEffect(gain(1, LATE))]),
        MachineEffect("leakage", [SelectedEffect(leakage(0, None)), SelectedEffect(leakage(1, EARLY))]),
    ]
    active = active_effects(machine, effects)
    assert active is not None and active.setting.speed_scale is SETTING.speed_scale
    assert active.onset_ns == {"gain": {0: at(EARLY), 1: at(LATE)}, "leakage": {1: at(EARLY)}}
    np.testing.assert_allclose(active.values["gain"]["ratio_positive"], [RATIO, RATIO])
    always = active_effects(machine, [MachineEffect("gain", [SelectedEffect(gain(0, None))])])
    assert always is not None and always.onset_ns == {}
