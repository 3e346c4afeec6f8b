"""What nominal logs ask for, too, is dropped, and the rest fitted again."""

from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.discrepancy.acceptance import accept as accepting
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.size_of_an_effect import Asked
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate

ASKED_FOR = {"flow_coupling": 0.7, "thermal_drift": 0.9, "lag": 0.2}  # shares of their size, of nominal logs


@pytest.mark.parametrize(
    ("present", "is_of_one_machine", "left"),
    [
        ((), False, ["lag"]),
        (("thermal_drift",), False, ["thermal_drift", "lag"]),  # nominal logs show it, and are no evidence
        ((), True, ["flow_coupling", "thermal_drift", "lag"]),  # they have what is sought
    ],
)
def test_the_rest_is_fitted_again(monkeypatch, present, is_of_one_machine: bool, left: list[str]) -> None:
    effects = [MachineEffect(family, [SelectedEffect(bare_candidate(family, 0))]) for family in ASKED_FOR]
    said: list[str] = []
    monkeypatch.setattr(
        accepting,
        "asked_for_on_nominal",
        lambda _, members: Asked(ASKED_FOR[members[0].candidate.family], squares=1.0),
    )
    monkeypatch.setattr(
        accepting,
        "refitted",
        lambda diagnosis, found: FittedEffects(
            diagnosis, found, [effect for effect in effects if effect.members[0] in found]
        ),
    )
    diagnosis: Any = SimpleNamespace(
        nominal=SimpleNamespace(present=present),
        logs=SimpleNamespace(is_of_one_machine=is_of_one_machine),
    )
    fit = FittedEffects(diagnosis, [member for effect in effects for member in effect.members], effects)
    passed = accepting.beyond_misfit(fit, said.append)
    assert [effect.family for effect in passed.effects] == left
    assert len(said) == len(effects) - len(left)
    assert (passed is fit) == (not said)
