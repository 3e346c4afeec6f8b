"""What is within the misfit is dropped, and the rest fitted again: a shared flow by the interval of its loss."""

from types import SimpleNamespace

import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy import close_loop
from pipeline.discrepancy.families.contract_parameters import plausible, quantity
from pipeline.discrepancy.selection.grouping import MachineEffect, effects_of
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.bare_candidate import bare_candidate

DEVIATION = 0.04


def stand_in(monkeypatch, parameters: dict, searched: list[SelectedEffect], excited: list[int]):
    """A loop of which only these parameters are known; with what it refits and says."""
    monkeypatch.setattr(close_loop, "parameters_of", lambda loop, effect: parameters[effect.family])
    loop, refits, said = close_loop.Loop.__new__(close_loop.Loop), [], []
    loop.config = load_section("close_loop", CloseLoopConfig, "paper")
    loop.excited, loop.say = excited, said.append
    loop.searched, loop.search = searched, SimpleNamespace(first=[])
    loop._refitted = lambda found: refits.append(found) or effects_of(found, [])
    return loop, refits, said


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
    loop, refits, said = stand_in(monkeypatch, parameters, [*flow.members, *lag.members], excited)
    left = loop._beyond_misfit([flow, lag])
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
    loop, refits, said = stand_in(monkeypatch, parameters, [gain, *supply], [0, 1, 2, 3])
    (left,) = loop._beyond_misfit(effects_of([gain, *supply[1:]], [0, 1, 2, 3]))
    assert left.family == "gain" and [c.family for c in left.equivalents] == ["supply_variation"]
    assert len(refits) == 1 and said[0].startswith("supply_variation is dropped: ")
