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
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.bare_candidate import bare_candidate

DEVIATION = 0.04


def beyond_misfit(
    monkeypatch: pytest.MonkeyPatch,
    parameters: dict,
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
    left = accepting.beyond_misfit(fit, said.append)
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
    left, refits, said = beyond_misfit(monkeypatch, parameters, excited, [flow, lag])
    if stays:
        assert left == [flow, lag] and refits == [] and said == []
    else:
        assert left == [lag] and refits == [lag.members]
        assert said[0].startswith("flow_coupling is dropped")
