"""Which names candidates may bear, and when a cause of several joints comes before one on a single joint."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.families import uncorrectable
from pipeline.discrepancy.families.plausibility import is_at_bound, is_plausible
from pipeline.discrepancy.families.whole_machine import common_causes
from pipeline.discrepancy.selection import search as search_module
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import Folds, t_statistic
from pipeline.discrepancy.selection.search import Search
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Setting

SETTING = Setting(0.05, -np.ones(3), np.ones(3), np.ones(3))
EFFECTS = {
    family: KNOWN[family](SETTING)
    for family in ("gain", "lag", "oscillation", "load", "end_cushion", "stiction")
}


def candidate(family: str, joint: int, gain: float, coefficients=(), point=None, freed=()) -> Candidate:
    blocks = np.full(10, gain / 10)
    return Candidate(family, joint, None, point or {}, freed, np.array(coefficients), gain, 0.3, blocks)


def coupling(joint: int, gain: float, coefficients: tuple[float, ...] = (0.2, 0.1)) -> Candidate:
    """A joint of three that loses speed by the two others and, of more coefficients, by itself."""
    others = [("loss_fraction", source) for source in range(3) if source != joint]
    alone = [("loss_alone_positive", None), ("loss_alone_negative", None)]
    freed = tuple((one,) for one in (others + alone)[: len(coefficients)])
    return candidate("flow_coupling", joint, gain, coefficients, freed=freed)


def chosen(*candidates: Candidate) -> list[tuple[str, int]]:
    best = max(candidates, key=lambda c: c.gain)
    found = common_causes(best, candidates, lambda c: c.gain, lambda c: c.gain > 1.0)
    return [(c.family, c.joint) for of in found[:1] for c in of]


def test_a_payload_comes_before_a_gain_per_joint() -> None:
    loads = [candidate("load", joint, 90.0, (-0.2, 0.1)) for joint in range(3)]
    gains = [candidate("gain", joint, 95.0) for joint in range(3)]
    assert chosen(*loads, *gains) == [("load", 0), ("load", 1), ("load", 2)]


def test_one_joint_alone_is_no_common_cause() -> None:
    load, gain = candidate("load", 0, 90.0, (-0.2, 0.1)), candidate("gain", 0, 95.0)
    assert chosen(load, gain, candidate("load", 1, 0.5, (-0.2, 0.1))) == []


def test_a_dependence_on_activity_has_to_explain_more_than_a_cause_with_an_equation() -> None:
    coupled = [coupling(joint, 60.0) for joint in range(3)]
    active = [candidate("other:activity", joint, 63.0) for joint in range(3)]
    assert {family for family, _ in chosen(*coupled, *active)} == {"flow_coupling"}
    active = [candidate("other:activity", joint, 75.0) for joint in range(3)]
    assert {family for family, _ in chosen(*coupled, *active)} == {"other:activity"}


@pytest.mark.parametrize(
    ("family", "coefficients", "expected"),
    [
        ("load", (-0.2, 0.1), True),  # slower up, faster down
        ("load", (-0.2, 0.0), False),  # a gain, in one direction
        ("load", (-0.2, -0.19), False),  # slower both ways
        ("load", (-0.02, 0.07, 0.01, 0.15, 0.18), True),  # opposed in most poses, if not in the middle
        ("load", (-0.2, -0.19, 0.01, 0.05, 0.06), False),
        ("gain", (-0.5,), True),
    ],
)
def test_signs_of_the_cause(family, coefficients, expected) -> None:
    assert is_plausible(family, [candidate(family, 0, 1.0, coefficients)]) is expected


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"cold_speed_loss": 0.3}, True),
        ({"cold_speed_loss": -0.3}, False),
        ({"cold_speed_loss": 0.1, "cold_lag": -0.3}, True),
        ({"cold_speed_loss": -0.1, "cold_lag": 0.3}, True),  # late starts cost more than warm leaks
        ({"cold_speed_loss": 0.3, "warm_gain": -0.1}, True),
        ({"warm_gain": -0.1, "cold_speed_loss": 0.3}, True),
        ({"cold_speed_loss": 0.1, "warm_gain": -0.2}, False),  # a joint that stays slow when it is warm
        ({"cold_speed_loss": 0.24, "warm_gain": 0.48}, False),  # one that is faster from the start
        ({"warm_gain": -0.2}, False),
    ],
)
def test_oil_that_warms_up_makes_faster(values, expected) -> None:
    freed = tuple(((name, None),) for name in values)
    oil = candidate("thermal_drift", 0, 1.0, tuple(values.values()), freed=freed)
    assert is_plausible("thermal_drift", [oil]) is expected


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((0.3, 0.2), True),
        ((0.9, 0.4), False),  # more than all of the speed
        ((0.3, 0.2, 0.1, 0.4), True),  # the pump is too small for the joint alone, too
        ((0.1, 0.1, 0.3, 0.0), False),  # a gain
        ((0.4, 0.3, 0.0, 0.35), False),
    ],
)
def test_a_shared_supply_shows_where_joints_move_at_once(coefficients, expected) -> None:
    assert is_plausible("flow_coupling", [coupling(1, 1.0, coefficients)]) is expected


@pytest.mark.parametrize(("widths_s", "expected"), [((0.7, 0.7, 6.0), False), ((0.7, 3.0, 6.0), True)])
def test_a_supply_varies_more_slowly_than_joints_start_and_stop(widths_s, expected) -> None:
    showing = [candidate("supply_variation", j, 50.0, point={"width": w}) for j, w in enumerate(widths_s)]
    assert is_plausible("supply_variation", showing) is expected


def test_a_joint_slowed_alone_belongs_to_the_pump_that_slows_the_others() -> None:
    alone = coupling(0, 90.0, (0.0, 0.0, 0.2, 0.1))
    coupled = [coupling(1, 60.0), coupling(2, 60.0)]
    assert {family for family, _ in chosen(alone, *coupled)} == {"flow_coupling"}
    assert chosen(alone, candidate("gain", 0, 95.0), candidate("gain", 1, 20.0)) == []


def test_a_value_at_its_bound_is_no_name() -> None:
    share = ((("share", None),),)
    inside = {"frequency": 2.0, "damping_ratio": 0.1}
    assert not is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.0,), inside, share))
    assert is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.5,), inside, share))
    overdamped = {"frequency": 2.0, "damping_ratio": 0.9}
    assert is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.0,), overdamped, share))
    assert not is_at_bound(EFFECTS, candidate("other:position", 0, 1.0, (2.0,)))
    late_at_starts_only = {"added_time_constant": 0.2, "fall_share": 0.15}
    assert is_at_bound(EFFECTS, candidate("lag", 0, 1.0, (), late_at_starts_only))
    any_rest = {"mean_extra_time": 0.2, "rest_threshold": 0.15}
    assert not is_at_bound(EFFECTS, candidate("stiction", 0, 1.0, (), any_rest))
    standstill = candidate("end_cushion", 0, 1.0, (0.95,), {"zone_share": 0.2}, ((("loss_upper", None),),))
    assert not is_at_bound(EFFECTS, standstill)  # no speed at all is a limit of nature


def search(folds: Folds) -> Search:
    """A search on rows of two folds, with nothing found."""
    rows = ScoredRows(
        np.ones((1, 2 * len(folds.fold)), bool), folds, np.ones(1), np.ones((len(folds.fold), 1))
    )
    simulation = SimpleNamespace(effects=EFFECTS)
    settings = load_section("close_loop", CloseLoopConfig, "paper").search
    return Search(simulation, rows, {}, settings, (), {}, ("lift", "turn"), (0, 1), lambda _: None)


def test_what_is_rare_but_reproduced_by_both_halves_of_the_rows_counts() -> None:
    block = np.repeat(np.arange(40), 10)
    looking = search(Folds(block % 2, block, 40))

    def rare(gains: dict[int, float], share: float = 0.5) -> Candidate:
        blocks = np.zeros(40)
        blocks[list(gains)] = list(gains.values())
        total = float(blocks.sum())
        return Candidate("other:command", 0, 0, {}, (), np.zeros(1), total, share, blocks)

    twice, once = rare({4: 150.0, 7: 120.0}), rare({4: 150.0, 6: 120.0})  # blocks of both folds, and of one
    smallest_t = looking.config.smallest_t
    assert max(t_statistic(twice.gain_by_block), t_statistic(once.gain_by_block)) < smallest_t
    assert looking.passes(twice) and not looking.passes(once)
    assert not looking.passes(replace(twice, share=0.05))
    assert not looking.passes(replace(twice, onset=1))  # before an onset there is nothing to be reproduced


@pytest.mark.parametrize(
    ("family", "gain", "share", "is_kept"),
    [
        ("gain", 60.0, 0.8, True),  # little beside the first, but most of what it leaves
        ("gain", 60.0, 0.2, False),  # a repair
        ("gain", 300.0, 0.2, True),  # much beside the first
        ("other:warmth", 60.0, 0.8, False),  # flexible as it is, it mends anything
    ],
)
@pytest.mark.parametrize("first", ["delay", "thermal_drift", "flow_coupling"])
def test_a_second_cause_explains_most_of_what_the_first_leaves(family, gain, share, is_kept, first) -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    looking.found = [SelectedEffect(candidate(first, 0, 1000.0 if first == "delay" else 400.0))]
    second = replace(candidate(family, 0, gain), share=share)
    assert looking._is_repair(second) is not is_kept


def test_what_a_common_change_of_speed_leaves_is_no_joints_own_course(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    course, rest = candidate("other:absolute_time", 0, 50.0), candidate("gain", 0, 40.0)
    monkeypatch.setattr(search_module, "screen", lambda *_, **__: [rest])
    monkeypatch.setattr(search_module, "with_onsets", lambda *arguments: arguments[3])
    monkeypatch.setitem(uncorrectable.TRIED, "other:absolute_time", lambda *_: [course])
    monkeypatch.setitem(uncorrectable.TRIED, "supply_variation", lambda *_: [])
    assert looking._candidates() == [rest, course]
    looking.found = [SelectedEffect(candidate("supply_variation", 0, 100.0, point={"width": 6.0}))]
    assert looking._candidates() == [rest]


def test_what_is_left_is_looked_at_with_every_onset_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    monkeypatch.setattr(search_module, "encoder_errors", lambda *_: [])
    monkeypatch.setattr(search_module, "refine", lambda simulation, rows, found: found)
    monkeypatch.setattr(search_module, "completed", lambda simulation, of, _: of)
    monkeypatch.setattr(looking, "_look_back", lambda: None)
    seen: list[dict] = []
    sets_in = replace(candidate("load", 1, 50.0), onset=7)

    def candidates() -> list[Candidate]:
        seen.append(hypothesis_of(looking.simulation, looking.found).onsets)
        return [sets_in] if len(seen) == 1 else []

    monkeypatch.setattr(looking, "_candidates", candidates)
    monkeypatch.setattr(looking, "_may_stand_alone", lambda *_: True)
    monkeypatch.setattr(looking, "_choose", lambda passing, _: [SelectedEffect(c) for c in passing])
    looking.run()
    assert seen == [{}, {("load", 1): 7}]


def test_a_dependence_that_explains_more_than_the_name_takes_its_certainty() -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    gain = candidate("gain", 0, 100.0)
    assert looking.comparison.raises_doubt(candidate("other:warmth", 0, 104.0), gain)
    assert not looking.comparison.raises_doubt(candidate("other:warmth", 0, 99.5), gain)
    assert not looking.comparison.raises_doubt(candidate("load", 0, 104.0), gain)  # with more freedom
    assert looking.comparison.raises_doubt(candidate("load", 0, 115.0), gain)
    assert not looking.comparison.raises_doubt(
        candidate("other:warmth", 0, 104.0), candidate("other:travel", 0, 100.0)
    )


def test_what_explains_clearly_more_with_an_implausible_value_takes_a_names_certainty() -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    looking._refined = list  # nothing moves off its grid
    gain = candidate("gain", 0, 100.0, (-0.2,), {}, ((("ratio_positive", None),),))
    late = {"added_time_constant": 0.2, "fall_share": 0.15}
    for of_lag, expected in ((130.0, ["lag"]), (105.0, [])):
        lag = candidate("lag", 0, of_lag, (), late)
        (found,) = looking._choose([gain, lag], [gain, lag])
        assert found.candidate is gain
        assert [c.family for c in found.equivalents] == expected


def test_a_gain_that_explains_nearly_as_much_takes_the_certainty_from_an_encoders_speeds() -> None:
    looking = search(Folds(np.arange(10) % 2, np.arange(10), 10))
    encoder = candidate("sensor_bias", 0, 100.0, (), {"scale": 0.9})
    for of_gain, expected in ((90.0, ["gain"]), (60.0, [])):
        gain = candidate("gain", 0, of_gain, (-0.2,), {}, ((("ratio_positive", None),),))
        equivalents = looking.comparison.equivalents(encoder, [encoder], [encoder, gain], [])
        assert [c.family for c in equivalents] == expected


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [((-0.3, -0.1), True), ((-0.3, 0.05), True), ((-0.2, 0.15), False), ((0.1, -0.3), False)],
)
def test_no_actuator_is_slower_one_way_and_faster_the_other(coefficients: tuple, expected: bool) -> None:
    both_ways = ((("ratio_positive", None),), (("ratio_negative", None),))
    found = candidate("gain", 0, 1.0, coefficients, freed=both_ways)
    assert is_plausible("gain", [found]) is expected


@pytest.mark.parametrize("family", ["supply_variation", "thermal_drift"])
def test_what_all_joints_have_in_common_shows_on_more_than_one(family: str) -> None:
    n_blocks = 40
    block = np.repeat(np.arange(n_blocks), 10)
    one = search(Folds(np.arange(400) % 2, block, n_blocks))

    def shows(joint: int, gain: float) -> Candidate:
        point, freed = {"width": 3.0, "time_constant": 60.0}, (("cold_speed_loss", None),)
        found = candidate(family, joint, gain, (0.2,), point, (freed,))
        return replace(found, share=0.5, gain_by_block=np.full(n_blocks, gain / n_blocks))

    here, there, nowhere = shows(0, 50.0), shows(1, 40.0), shows(1, -1.0)
    assert one._may_stand_alone(here, [here, there])
    assert not one._may_stand_alone(here, [here, nowhere])
