"""A shared flow has to take more than nominal logs of other work ask for, by the interval of its loss."""

import pytest

from pipeline.configuration import load_section
from pipeline.discrepancy import close_loop
from pipeline.discrepancy.contract_parameters import plausible, quantity
from pipeline.discrepancy.found import Found
from pipeline.discrepancy.grouping import Effect, effects_of
from pipeline.discrepancy.settings import CloseLoopConfig

from .bare_candidate import bare_candidate

DEVIATION = 0.04


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
    monkeypatch.setattr(close_loop, "parameters_of", lambda loop, effect: parameters[effect.family])
    loop, refits, said = close_loop.Loop.__new__(close_loop.Loop), [], []
    loop.config = load_section("close_loop", CloseLoopConfig, "paper")
    loop.excited, loop.say = excited, said.append
    loop._refitted = lambda found: refits.append(found) or effects_of(found, [])
    flow = Effect("flow_coupling", [Found(bare_candidate("flow_coupling", joint)) for joint in (0, 1, 2)])
    lag = Effect("lag", [Found(bare_candidate("lag", 0))])
    left = loop._beyond_misfit([flow, lag])
    if stays:
        assert left == [flow, lag] and refits == [] and said == []
    else:
        assert left == [lag] and refits == [lag.members]
        assert said[0].startswith("flow_coupling is dropped")
