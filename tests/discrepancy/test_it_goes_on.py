"""Day after day: the next run begins with what the last one found, and says what is new since."""

from pathlib import Path

import pytest

from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.dynamics.model.store import load_model, save_model
from pipeline.effects.store import ActiveEffects, load_active, save_effects
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from tests.discrepancy.test_close_loop import MACHINE, record, settings

pytestmark = [pytest.mark.slow, pytest.mark.long]

SLOWER, SAG = 0.7, (0.03, 0.03, 0.03)


@pytest.fixture(scope="module")
def nominal() -> list[Trajectory]:
    return [record(f"nominal_{seed}", seed, 5000) for seed in (1, 2)]


@pytest.fixture(scope="module")
def usual(nominal: list[Trajectory]) -> NominalBehaviour:
    return learn_nominal_behaviour(nominal, MACHINE, *settings())


def close(
    nominal: list[Trajectory],
    usual: NominalBehaviour,
    measured: list[Trajectory],
    given: ActiveEffects | None = None,
) -> ClosedLoop:
    model = (usual.diagnosis.model, usual.diagnosis.parameters)
    return close_loop(nominal, measured, MACHINE, model, *settings(), nominal_behaviour=usual, given=given)


@pytest.fixture(scope="module")
def yesterday(
    nominal: list[Trajectory], usual: NominalBehaviour, tmp_path_factory: pytest.TempPathFactory
) -> ActiveEffects:
    """Of the model that the first day's run saves: `turn` is slower on its way down."""
    measured = [record(f"day_1_{seed}", seed, 4000, slower=SLOWER) for seed in (11, 12)]
    result = close(nominal, usual, measured)
    assert [(of["family"], of["joints"]) for of in result.document["effects"]] == [("gain", ["turn"])]
    assert "known" not in result.document and result.effects is not None
    folder: Path = tmp_path_factory.mktemp("model_after")
    save_model(folder, result.model, result.parameters, {}, {}, {})
    save_effects(folder, result.effects)
    load_model(folder)
    active = load_active(folder)
    assert active is not None
    return active


def test_what_is_new_is_told_apart_from_what_was_known(nominal, usual, yesterday) -> None:  # type: ignore[no-untyped-def]
    measured = [record(f"day_2_{seed}", seed, 4000, slower=SLOWER, sag=SAG) for seed in (21, 22)]
    result = close(nominal, usual, measured, yesterday)
    document = result.document
    assert [(of["family"], of["joints"]) for of in document["effects"]] == [("leakage", ["lift"])]
    (known,) = document["known"]
    assert (known["family"], known["joints"], known["state"]) == ("gain", ["turn"], "unchanged")
    before, now = (known[when]["speed_ratio"]["value"] for when in ("before", "now"))
    assert before == pytest.approx(yesterday.values["gain"]["ratio_negative"][1])
    assert now == pytest.approx(SLOWER, abs=0.04)
    assert result.effects is not None and set(result.effects.families()) == {"gain", "leakage"}
    # The model before is yesterday's, with its effect.
    errors = document["error"]["open_loop_rmse_80"]
    assert errors["after"]["lift"] < 0.6 * errors["before"]["lift"]
    assert errors["after"]["turn"] == pytest.approx(errors["before"]["turn"], rel=0.05)
    assert result.given is yesterday


def test_a_day_like_the_last_shows_nothing_new(nominal, usual, yesterday) -> None:  # type: ignore[no-untyped-def]
    measured = [record(f"day_3_{seed}", seed, 4000, slower=SLOWER) for seed in (31, 32)]
    document = close(nominal, usual, measured, yesterday).document
    assert (document["verdict"], document["detected"], document["effects"]) == ("none", False, [])
    assert [of["state"] for of in document["known"]] == ["unchanged"]


@pytest.mark.parametrize(("slower", "state"), [(0.5, "grown"), (1.0, "gone")])
def test_what_was_known_has_grown_or_is_gone(nominal, usual, yesterday, slower, state) -> None:  # type: ignore[no-untyped-def]
    measured = [record(f"day_4_{seed}", seed, 4000, slower=slower) for seed in (41, 42)]
    result = close(nominal, usual, measured, yesterday)
    assert result.document["effects"] == []
    (known,) = result.document["known"]
    assert known["state"] == state
    errors = result.document["error"]["open_loop_rmse_80"]
    assert errors["after"]["turn"] < 0.5 * errors["before"]["turn"]
    if state == "gone":
        assert known["now"] is None and result.effects is None
    else:
        assert known["now"]["speed_ratio"]["value"] == pytest.approx(slower, abs=0.04)


def test_logs_that_show_the_effects_already_are_not_taken_for_nominal(usual, yesterday) -> None:  # type: ignore[no-untyped-def]
    nominal = [record("day_1", seed, 4000, slower=SLOWER) for seed in (11, 12)]
    with pytest.raises(InputError, match=r"nominal logs show the effects that the model has already.*turn"):
        close(nominal, usual, nominal[:1], yesterday)
