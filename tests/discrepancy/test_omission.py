"""What a given model lacks of logs: a grey box of joints by themselves, on joints that share their flow."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from pipeline.discrepancy.close_loop import close_loop
from pipeline.dynamics.model.features import History, push
from pipeline.dynamics.model.stepwise_model import StepwiseModel
from pipeline.dynamics.model.stops import Stops
from pipeline.errors import InputError
from tests.discrepancy.test_close_loop import CONSTANTS_S, DT_S, MACHINE, SPEEDS, record, settings
from tests.dynamics.conftest import make_specification

SHARED = 0.35  # of its speed a joint loses while the other one moves


class GreyBox(StepwiseModel):
    """First-order joints, each by itself: exactly the machine of `record`, but for the shared flow."""

    def step(
        self, parameters: dict, history: History, command: jax.Array, stops: Stops | None = None
    ) -> History:
        newest = history.motion[..., -1, :]
        residual = (1.0 - np.exp(-DT_S / CONSTANTS_S)) * (SPEEDS * command - newest)
        q, newest = self._moved(history.q, newest, residual, stops)
        return History(push(history.motion, newest), push(history.commands, command), q)


def grey_box() -> GreyBox:
    limits = {"position_lower": MACHINE.lower.tolist(), "position_upper": MACHINE.upper.tolist()}
    return GreyBox(replace(make_specification("mlp", "dqdot"), joints=list(MACHINE.joint_names), **limits))


@pytest.mark.long
def test_a_grey_box_without_flow_coupling_is_told_that_it_lacks_it() -> None:
    logs = [record(f"as_it_is_{seed}", seed, 5000, shared=SHARED) for seed in (1, 2)]
    result = close_loop(logs, None, MACHINE, (grey_box(), {}), *settings())
    document = result.document
    assert document["verdict"] == "named"
    effect = document["effects"][0]
    assert (effect["family"], effect["joints"]) == ("flow_coupling", ["turn"])
    errors = document["error"]["open_loop_rmse_80"]
    assert errors["after"]["turn"] < 0.4 * errors["before"]["turn"]
    assert errors["after"]["lift"] == pytest.approx(errors["before"]["lift"], rel=0.05)
    assert result.effects is not None
    lost = result.effects.values["flow_coupling"]["loss_fraction"]
    assert lost[1, 0] == pytest.approx(SHARED, abs=0.05)
    assert any("the same" in warning for warning in result.evidence.warnings)


def test_without_measured_logs_a_model_must_be_given() -> None:
    with pytest.raises(InputError, match="neither measured logs nor a model"):
        close_loop([record("log", 1, 300)], None, MACHINE, None, *settings())
