"""Intervals: what several joints say together, and what the model's own misfit adds."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.acceptance import parameter_misfit
from pipeline.discrepancy.acceptance.parameter_misfit import misfit_covariance
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, averaged
from pipeline.discrepancy.families.contract_parameters import (
    Spread,
    describe,
    of_all_joints,
    plausible,
    quantity,
    spreads,
    weighted_mean,
)
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.lag import Lag
from tests.discrepancy.bare_candidate import bare_candidate

N_ROWS, DT_S = 600, 0.05
ONE_JOINT = Setting(DT_S, np.array([-1.0]), np.array([1.0]), np.array([1.0]))


def test_joints_that_agree_are_weighted_by_precision() -> None:
    mean, deviation = weighted_mean(np.array([1.0, 1.3]), np.array([0.1, 0.2]))
    assert np.isclose(mean, (1.0 / 0.01 + 1.3 / 0.04) / (1.0 / 0.01 + 1.0 / 0.04))
    assert np.isclose(deviation, (1.0 / 0.01 + 1.0 / 0.04) ** -0.5 * max(1.0, 0.3 / np.hypot(0.1, 0.2)))


def test_what_joints_may_have_in_common_is_not_averaged_away() -> None:
    _, deviation = weighted_mean(np.full(4, 1.0), np.full(4, 0.1))
    assert np.isclose(deviation, 0.1)  # errors that are one: of the mean as large as of each


def test_joints_that_disagree_widen_the_interval() -> None:
    _, agreeing = weighted_mean(np.array([1.0, 1.0, 1.0]), np.full(3, 0.01))
    _, disagreeing = weighted_mean(np.array([0.8, 1.0, 1.2]), np.full(3, 0.01))
    assert disagreeing > 10.0 * agreeing


def test_intervals_end_where_nothing_is_possible() -> None:
    given = {
        "time_constant:boom": quantity(400.0, "s", 230.0),
        "offset": quantity(0.01, "rad", 0.02),
        "side": {"value": -1, "unit": "sign"},
    }
    told = plausible(given)
    assert told["time_constant:boom"]["ci95"] == [0.0, 400.0 + 1.96 * 230.0]
    assert told["offset"]["ci95"] == pytest.approx([0.01 - 1.96 * 0.02, 0.01 + 1.96 * 0.02])
    assert told["side"] == given["side"]
    assert set(told["offset"]) == {"value", "unit", "ci95"}


def test_parameters_that_not_all_joints_have_keep_their_joints() -> None:
    swing = {"loss": quantity(0.2, "1", 0.1), "loss_to:boom": quantity(0.2, "1", 0.1)}
    boom = {"loss": quantity(0.4, "1", 0.1), "loss_to:swing": quantity(0.1, "1", 0.1)}
    arm = {
        "loss": quantity(0.6, "1", 0.1),
        "loss_to:swing": quantity(0.3, "1", 0.1),
        "alone": quantity(0.5, "1", 0.2),
    }
    merged = of_all_joints([swing, boom, arm], ["swing", "boom", "arm"])
    assert {name: merged[name]["value"] for name in merged} == pytest.approx(
        {
            "loss": 0.4,
            "loss:swing": 0.2,
            "loss:boom": 0.4,
            "loss:arm": 0.6,
            "loss_to:boom": 0.2,
            "loss_to:boom:swing": 0.2,
            "loss_to:swing": 0.2,
            "loss_to:swing:boom": 0.1,
            "loss_to:swing:arm": 0.3,
            "alone": 0.5,
            "alone:arm": 0.5,
        }
    )


@pytest.mark.parametrize("n_joint", [1, 3])
def test_a_deviation_ends_where_nothing_is_plausible_however_many_joints_know_nothing(n_joint) -> None:
    both = (("ratio_positive", None), ("ratio_negative", None))
    effect = Gain(ONE_JOINT)
    coordinate = Coordinate(0, None, 0, -0.3, 0.3)
    candidate = Candidate("gain", 0, None, {}, (both,), np.array([0.1]), 0.0, 0.0, np.zeros(1))

    def deviation(variance: float) -> float:
        spread = spreads([coordinate], np.array([[variance]]), 0, candidate, model_error=0.0)
        assert spread["coefficient:0"] == Spread(pytest.approx(variance**0.5), pytest.approx(0.6 / 12.0**0.5))
        described = describe(candidate, effect, spread, ["swing"], "rad")
        told = plausible(of_all_joints([described] * n_joint, ["a", "b", "c"][:n_joint]))["speed_ratio"]
        return (told["ci95"][1] - told["ci95"][0]) / (2.0 * 1.96)

    uniform = 0.6 / np.sqrt(12.0)
    assert np.isclose(deviation(1e6), uniform, rtol=1e-3)
    assert np.isclose(deviation(1e-4), 1e-2, rtol=2e-3)
    assert np.isclose(deviation(uniform**2), (2.0 / uniform**2) ** -0.5)  # precisions add


def told_lag(fall_share: float):
    lag = bare_candidate("lag", 0, added_time_constant=0.2, fall_share=fall_share)
    spread = {"added_time_constant": Spread(0.01, 1.0)}
    return describe(lag, Lag(ONE_JOINT), spread, ("swing",), "rad")["added_time_constant"]


def test_a_lag_alike_at_starts_and_stops_has_one_time_constant() -> None:
    told = told_lag(1.0)
    assert told["value"] == pytest.approx(0.2)
    assert told["ci95"] == pytest.approx([0.2 - 1.96 * 0.01, 0.2 + 1.96 * 0.01])


def test_of_a_lag_that_stops_sooner_the_interval_holds_both_readings() -> None:
    lower, upper = told_lag(0.2)["ci95"]
    assert lower < 0.5 * (0.2 + 0.2 * 0.2) and upper > 0.2  # the mean of starts and stops; starts


def gain_of_one_joint(ratio: float):
    """A machine whose nominal velocity is known, and measured logs of it with another speed in each third."""
    u = np.sin(0.21 * np.arange(N_ROWS))[None, :, None]
    effect = Gain(ONE_JOINT)
    thirds = np.repeat([1.0 + ratio, 1.0, 1.0 - ratio], N_ROWS // 3)[None, :, None]
    is_used = np.ones((1, N_ROWS), bool)
    n = N_ROWS // 2

    def velocities(hypotheses):
        ratios = [
            (h.values.get("gain") or effect.neutral())["ratio_positive"][0] for h in hypotheses
        ]  # both directions alike
        return np.stack([ratio * u for ratio in ratios])

    simulation = SimpleNamespace(
        effects={"gain": effect},
        sequences=SimpleNamespace(velocity=thirds * u),
        velocities=velocities,
    )
    rows = ScoredRows(
        is_used, Folds(np.zeros(n, int), np.arange(n) // 10, n // 10), np.ones(1), np.ones((n, 1))
    )
    return simulation, rows


def test_misfit_is_what_nominal_parts_ask_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parameter_misfit, "MISFIT_PARTS", 3)
    simulation, rows = gain_of_one_joint(0.1)
    both = (("ratio_positive", None), ("ratio_negative", None))
    found = [SelectedEffect(Candidate("gain", 0, None, {}, (both,), np.array([-0.3]), 0.0, 0.0, np.zeros(1)))]
    covariance = misfit_covariance(simulation, rows, found)[0]
    # Parts ask for +0.1, 0 and -0.1, each weighted by its share of the squared motion.
    motion = averaged(np.sin(0.21 * np.arange(N_ROWS))[None], rows.is_used) ** 2
    asked = [
        0.1 * sign * part.sum() / motion.mean() / len(part)
        for sign, part in zip((1, 0, -1), np.split(motion, 3), strict=True)
    ]
    assert np.isclose(covariance[0, 0], np.mean(np.square(asked)), rtol=1e-3)


def test_no_misfit_adds_nothing() -> None:
    simulation, rows = gain_of_one_joint(0.0)
    both = (("ratio_positive", None), ("ratio_negative", None))
    found = [SelectedEffect(Candidate("gain", 0, None, {}, (both,), np.array([-0.3]), 0.0, 0.0, np.zeros(1)))]
    assert misfit_covariance(simulation, rows, found)[0][0, 0] < 1e-18
