"""Joints that all respond late: when it is the oil, and when it only may be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.families import cold_oil as module
from pipeline.discrepancy.families.cold_oil import OF_OWN_CAUSES, cold_oil, with_doubts_of_the_oil
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Setting
from tests.discrepancy.bare_candidate import bare_candidate

COMPARISON = Comparison(
    Folds(np.arange(40) % 2, np.arange(40) // 10, 4),
    load_section("close_loop", CloseLoopConfig, "paper").search,
)
SIMULATION = SimpleNamespace(
    effects={"thermal_drift": KNOWN["thermal_drift"](Setting(0.05, -np.ones(4), np.ones(4), np.ones(4)))}
)


def candidate(family: str, joint: int, gain: float) -> Candidate:
    """With what it explains once it is fitted; an oil that slows, and is warm at the nominal speed."""
    bare = bare_candidate(family, joint)
    if family == "thermal_drift":
        bare = replace(bare, freed=((("cold_speed_loss", None),),), coefficients=np.array([0.3]))
    return replace(bare, gain=gain, gain_by_block=np.full(4, gain / 4))


def named(candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch, excited: range = range(4)) -> list:
    monkeypatch.setattr(module, "refined_together", lambda simulation, rows, found, some: some)
    oil = cold_oil(SIMULATION, None, [], candidates, COMPARISON, excited)
    return [f.candidate.joint for f in oil]


@pytest.mark.parametrize("rival", ["lag", "delay"])
def test_it_is_the_oil_where_it_explains_about_as_much_as_each_joints_own_cause(rival, monkeypatch) -> None:
    share = OF_OWN_CAUSES[rival]
    for of_oil, expected in ((share + 0.02, [3, 2, 1, 0]), (share - 0.02, [])):
        oil = [candidate("thermal_drift", joint, of_oil * (100 + joint)) for joint in range(4)]
        lags = [candidate("lag", joint, 100.0 + joint if rival == "lag" else 1.0) for joint in range(4)]
        late = [candidate("delay", joint, 100.0 + joint if rival == "delay" else 1.0) for joint in range(4)]
        assert named([*oil, *lags, *late], monkeypatch) == expected


def test_a_joint_that_is_not_late_clears_the_oil(monkeypatch) -> None:
    oil = [candidate("thermal_drift", joint, 100.0) for joint in range(4)]
    lags = [candidate("lag", joint, 90.0) for joint in range(4)]
    assert len(named([*oil, *lags], monkeypatch)) == 4
    assert named([*oil, *lags[:3]], monkeypatch) == []
    assert len(named([*oil[:3], *lags[:3]], monkeypatch, range(3))) == 3
    assert named([*oil[:2], *lags[:2]], monkeypatch, range(2)) == []  # two valves may be sluggish


def test_lags_that_explain_as_much_take_the_oils_certainty(monkeypatch) -> None:
    monkeypatch.setattr(module, "refined_together", lambda simulation, rows, found, some: some)
    lags = [candidate("lag", joint, 100.0) for joint in range(3)]
    for of_oil, scatter, expected in ((105.0, 20.0, ["lag"]), (105.0, 0.1, []), (115.0, 20.0, [])):
        blocks = of_oil / 4 + scatter * np.array([1.0, -1.0, 1.0, -1.0])
        oil = [replace(candidate("thermal_drift", j, of_oil), gain_by_block=blocks) for j in range(3)]
        for effect in cold_oil(SIMULATION, None, [], [*oil, *lags], COMPARISON, range(3)):
            assert [e.family for e in effect.equivalents] == expected
            assert all(e.joint == effect.candidate.joint for e in effect.equivalents)


def test_oil_that_is_warm_and_yet_slow_is_no_oil(monkeypatch) -> None:
    warm_first = ((("warm_gain", None),), (("cold_speed_loss", None),))  # by name, not by order
    oil = [
        replace(
            candidate("thermal_drift", joint, 100.0), freed=warm_first, coefficients=np.array([-0.3, 0.1])
        )
        for joint in range(4)
    ]
    assert named([*oil, *(candidate("lag", joint, 90.0) for joint in range(4))], monkeypatch) == []


def test_joints_that_respond_late_one_like_the_other_may_be_cold() -> None:
    found = [SelectedEffect(bare_candidate("lag", joint)) for joint in (0, 2)]
    found.append(SelectedEffect(bare_candidate("stiction", 1)))
    screened = [bare_candidate("thermal_drift", joint) for joint in range(4)]
    first, second, alone = with_doubts_of_the_oil(found, screened)
    assert first.equivalents == [screened[0]]
    assert second.equivalents == [screened[2]]
    assert alone.equivalents == []


def test_gains_of_two_joints_have_two_causes() -> None:
    found = [SelectedEffect(bare_candidate("gain", joint)) for joint in (0, 1)]
    screened = [bare_candidate("thermal_drift", joint) for joint in range(2)]
    assert with_doubts_of_the_oil(found, screened) == found
