"""What is within the misfit is dropped, and the rest fitted again: a shared flow by the interval of its loss."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.acceptance import accept as accepting
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.families.contract_parameters import plausible, quantity
from pipeline.discrepancy.selection.grouping import MachineEffect, effects_of
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.bare_candidate import bare_candidate

DEVIATION = 0.04


def beyond_misfit(
    monkeypatch: pytest.MonkeyPatch,
    parameters: dict,
    searched: list[SelectedEffect],
    excited: list[int],
    effects: Sequence[MachineEffect],
) -> tuple[Sequence[MachineEffect], list, list[str]]:
    """What is left of effects of which only these parameters are known; with what was refitted and said."""
    refits: list = []
    said: list[str] = []

    def refitted(diagnosis: Any, found: list[SelectedEffect]) -> FittedEffects:
        refits.append(found)
        return FittedEffects(diagnosis, found, effects_of(found, []))

    monkeypatch.setattr(accepting, "parameters_of", lambda fit, effect: parameters[effect.family])
    monkeypatch.setattr(accepting, "refitted", refitted)
    config = load_section("close_loop", CloseLoopConfig, "paper")
    diagnosis: Any = SimpleNamespace(logs=SimpleNamespace(config=config), excited=excited)
    fit = FittedEffects(diagnosis, [m for effect in effects for m in effect.members], effects)
    comparison: Any = None
    left = accepting.beyond_misfit(fit, Selection(searched, [], comparison, {}), said.append)
    return left.effects, refits, said


@pytest.mark.parametrize(
    ("deviations", "excited", "stays"),
    [
        (2.0, [0, 1, 2, 3], False),
        (2.9, [0, 1, 2, 3], False),
        (3.1, [0, 1, 2, 3], True),
        (8.0, [0, 1, 2, 3], True),
        (1.9, [0, 1, 2], False),
        (2.0, [0, 1, 2], True),  # borne out by every joint that moves
    ],
)
def test_a_loss_within_the_misfit_is_dropped_and_the_rest_fitted_again(
    monkeypatch, deviations: float, excited: list[int], stays: bool
) -> None:
    parameters = {
        "flow_coupling": plausible({"loss_fraction": quantity(deviations * DEVIATION, "1", DEVIATION)}),
        "lag": plausible({"added_time_constant": quantity(0.2, "s", 0.02)}),
    }
    flow = MachineEffect(
        "flow_coupling", [SelectedEffect(bare_candidate("flow_coupling", joint)) for joint in (0, 1, 2)]
    )
    lag = MachineEffect("lag", [SelectedEffect(bare_candidate("lag", 0))])
    searched = [*flow.members, *lag.members]
    left, refits, said = beyond_misfit(monkeypatch, parameters, searched, excited, [flow, lag])
    if stays:
        assert left == [flow, lag] and refits == [] and said == []
    else:
        assert left == [lag] and refits == [lag.members]
        assert said[0].startswith("flow_coupling is dropped")


@pytest.mark.parametrize("passed_on", [[1], [1, 2]])
def test_a_supply_that_is_dropped_bears_nothing_out(monkeypatch, passed_on: list[int]) -> None:
    """A gain beside a common change that the gate refused there is certain only where others bear the change out."""
    time_s = 3.0 if len(passed_on) == 1 else 0.5
    parameters = {"supply_variation": {"correlation_time": {"value": time_s, "unit": "s"}}}
    gain = SelectedEffect(bare_candidate("gain", 0))
    supply = [
        SelectedEffect(bare_candidate("supply_variation", joint, width=3.0)) for joint in (0, *passed_on)
    ]
    excited = [0, 1, 2, 3]
    effects = effects_of([gain, *supply[1:]], excited)
    (left,), refits, said = beyond_misfit(monkeypatch, parameters, [gain, *supply], excited, effects)
    assert left.family == "gain" and [c.family for c in left.equivalents] == ["supply_variation"]
    assert len(refits) == 1 and said[0].startswith("supply_variation is dropped: ")
