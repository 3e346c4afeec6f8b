"""Which effects may stay by what they do to predictions: errors are given here, per joint and per set of effects."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.correction.open_loop_gate import OpenLoopGate
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.bare_candidate import bare_candidate

CONFIG = load_section("close_loop", CloseLoopConfig, "paper").gate


def effect(family: str, *joints: int) -> MachineEffect:
    return MachineEffect(family, [SelectedEffect(bare_candidate(family, joint)) for joint in joints])


def fitted(effects: Sequence[MachineEffect]) -> FittedEffects:
    diagnosis: Any = None
    return FittedEffects(diagnosis, [member for e in effects for member in e.members], effects)


def names(effects: Sequence[MachineEffect]) -> list[tuple[str, tuple[int, ...]]]:
    return [(e.family, tuple(e.joints)) for e in effects]


@dataclass
class Case:
    """Squares per joint, 1 without effects; each effect on a joint multiplies that joint's by its factor."""

    factors: dict[tuple[str, int], float]
    refitted: dict[tuple[str, int], float] = field(default_factory=dict)  # once something was dropped
    refits: list = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    def errors(self, effects) -> WindowErrors:  # type: ignore[no-untyped-def]
        factors = {**self.factors, **(self.refitted if self.refits else {})}
        squares = np.ones(3)
        for e in effects:
            for joint in e.joints:
                squares[joint] *= factors.get((e.family, joint), 1.0)
        return WindowErrors(np.tile(squares, (5, 1)), np.arange(5))

    def refit(self, effects: Sequence[MachineEffect]) -> FittedEffects:
        self.refits.append(names(effects))
        return fitted(effects)

    def gate(self) -> OpenLoopGate:
        return OpenLoopGate(self.errors([]), self.errors, self.refit, CONFIG, self.said.append)


def test_what_does_no_harm_stays_as_it_is() -> None:
    case, fit = Case({("gain", 0): 0.3, ("lag", 1): 0.5}), fitted([effect("gain", 0), effect("lag", 1)])
    assert case.gate().passing(fit, lambda _: False) is fit
    assert case.refits == [] and case.said == []


def test_the_effect_goes_whose_absence_mends_the_joint_and_the_rest_is_fitted_again() -> None:
    case = Case({("gain", 0): 3.0, ("lag", 0): 0.9, ("delay", 1): 0.5})
    effects = [effect("gain", 0), effect("delay", 1), effect("lag", 0)]
    assert names(case.gate().without_harm(fitted(effects)).effects) == [("delay", (1,)), ("lag", (0,))]
    assert case.refits == [[("delay", (1,)), ("lag", (0,))]]


def test_where_no_single_absence_mends_the_joint_the_weakest_goes_first() -> None:
    case = Case({("gain", 0): 3.0, ("lag", 0): 3.0})
    assert case.gate().without_harm(fitted([effect("gain", 0), effect("lag", 0)])).effects == []
    assert case.refits == [[("gain", (0,))], []]


@pytest.mark.parametrize(("family", "left"), [("load", [("load", (1, 2))]), ("timing", [])])
def test_one_cause_leaves_the_joint_that_has_no_part_in_it_but_a_channel_is_late_or_not(family, left) -> None:
    case = Case({(family, 0): 2.0, (family, 1): 0.5, (family, 2): 0.5})
    of_family = effect("delay" if family == "timing" else family, 0, 1, 2)
    effects = [MachineEffect(family, of_family.members)]
    assert names(case.gate().without_harm(fitted(effects)).effects) == left


def test_what_removes_little_is_not_named_but_for_the_strongest_that_shows_otherwise() -> None:
    case = Case({("oscillation", 0): 0.99, ("lag", 1): 0.99, ("gain", 2): 0.5})
    effects = [effect("oscillation", 0), effect("lag", 1), effect("gain", 2)]
    kept = case.gate().worth_a_name(fitted(effects), lambda e: True)
    assert names(kept.effects) == [("oscillation", (0,)), ("gain", (2,))]
    assert names(case.gate().worth_a_name(fitted(effects), lambda e: False).effects) == [("gain", (2,))]


def test_what_does_harm_once_the_unnamed_is_gone_goes_too() -> None:
    case = Case({("gain", 0): 0.5, ("lag", 1): 0.99, ("delay", 1): 0.8}, refitted={("delay", 1): 2.0})
    effects = [effect("gain", 0), effect("delay", 1), effect("lag", 1)]
    assert names(case.gate().passing(fitted(effects), lambda _: False).effects) == [("gain", (0,))]
    assert case.refits == [[("gain", (0,)), ("delay", (1,))], [("gain", (0,))]]


def test_a_course_in_time_predicts_nothing_and_is_named_where_it_shows() -> None:
    course = effect("other:absolute_time", 1, 2)
    effects = [effect("gain", 0), course, effect("lag", 2)]
    case = Case({("gain", 0): 0.3})
    assert names(case.gate().worth_a_name(fitted(effects), lambda e: e is course).effects) == names(
        effects[:2]
    )
    assert names(case.gate().worth_a_name(fitted(effects), lambda _: False).effects) == names(effects[:1])
    assert case.gate().without_harm(fitted([course])).effects == [course]


def test_what_predicts_nothing_may_show_otherwise_wherever_it_stands() -> None:
    case = Case({("gain", 0): 0.3})
    effects = [effect("gain", 0), effect("supply_variation", 1, 2)]
    fit = fitted(effects)
    assert case.gate().passing(fit, lambda e: e.family == "supply_variation") is fit
    assert names(case.gate().worth_a_name(fitted(effects), lambda _: False).effects) == [("gain", (0,))]
    assert case.gate().error_reduction(effects[1]) == 0.0


@pytest.mark.parametrize(
    ("after", "stays"),
    [
        ([0.3, 0.3, 0.4, 2.6, 2.6], True),
        ([0.8, 1.6, 1.6, 1.5, 1.6], False),
        ([1.1] * 5, True),
        ([1.3] * 5, False),
    ],
)
def test_a_rise_that_one_stretch_of_the_logs_makes_is_no_harm(after: list[float], stays: bool) -> None:
    given = effect("gain", 0)

    def errors(effects) -> WindowErrors:  # type: ignore[no-untyped-def]
        squares = np.ones((5, 1)) if not effects else np.array(after)[:, None]
        return WindowErrors(squares, np.arange(5))

    gate = OpenLoopGate(errors([]), errors, fitted, CONFIG, lambda _: None)
    assert gate.without_harm(fitted([given])).effects == ([given] if stays else [])


def test_what_the_given_model_has_stays_and_what_is_new_is_judged_beside_it() -> None:
    """The known effect alone would be called harmful and worth no name; the new one shows only beside it."""
    known = MachineEffect(
        "gain", [SelectedEffect(candidate := bare_candidate("gain", 0), known=Known(candidate))]
    )
    new, idle = effect("lag", 1), effect("delay", 2)

    def errors(effects) -> WindowErrors:  # type: ignore[no-untyped-def]
        squares = np.ones(3)
        squares[0] = 3.0 if known in effects else 1.0
        squares[1] = 0.4 if new in effects and known in effects else 1.0
        return WindowErrors(np.tile(squares, (5, 1)), np.arange(5))

    before = WindowErrors(np.tile([1.0, 1.0, 1.0], (5, 1)), np.arange(5))
    gate = OpenLoopGate(before, errors, fitted, CONFIG, lambda _: None, [known])
    assert gate.passing(fitted([known, new, idle]), lambda _: False).effects == [known, new]
    assert gate.error_reduction(new) == pytest.approx(0.6)
