"""Which names candidates may bear, and when a cause of several joints comes before one on a single joint."""

import numpy as np
import pytest

from pipeline.discrepancy.plausibility import is_at_bound, is_plausible
from pipeline.discrepancy.screen import Candidate
from pipeline.discrepancy.whole_machine import common_cause
from pipeline.effects.effect import Setting
from pipeline.effects.store import KNOWN

SETTING = Setting(0.05, -np.ones(3), np.ones(3), np.ones(3))
EFFECTS = {family: KNOWN[family](SETTING) for family in ("gain", "oscillation", "load")}


def candidate(family: str, joint: int, gain: float, coefficients=(), point=None, freed=()) -> Candidate:
    blocks = np.full(10, gain / 10)
    return Candidate(family, joint, None, point or {}, freed, np.array(coefficients), gain, 0.3, blocks)


def chosen(*candidates: Candidate) -> list[tuple[str, int]]:
    best = max(candidates, key=lambda c: c.gain)
    found = common_cause(best, candidates, lambda c: c.gain, lambda c: c.gain > 1.0)
    return [(c.family, c.joint) for c in found]


def test_a_payload_comes_before_a_gain_per_joint() -> None:
    loads = [candidate("load", joint, 90.0, (-0.2, 0.1)) for joint in range(3)]
    gains = [candidate("gain", joint, 95.0) for joint in range(3)]
    assert chosen(*loads, *gains) == [("load", 0), ("load", 1), ("load", 2)]


def test_one_joint_alone_is_no_common_cause() -> None:
    load, gain = candidate("load", 0, 90.0, (-0.2, 0.1)), candidate("gain", 0, 95.0)
    assert chosen(load, gain, candidate("load", 1, 0.5, (-0.2, 0.1))) == []


def test_a_dependence_on_activity_has_to_explain_more_than_a_cause_with_an_equation() -> None:
    coupled = [candidate("flow_coupling", joint, 60.0, (0.2, 0.1)) for joint in range(3)]
    active = [candidate("other:activity", joint, 63.0) for joint in range(3)]
    assert {family for family, _ in chosen(*coupled, *active)} == {"flow_coupling"}
    active = [candidate("other:activity", joint, 75.0) for joint in range(3)]
    assert {family for family, _ in chosen(*coupled, *active)} == {"other:activity"}


@pytest.mark.parametrize(
    ("family", "coefficients", "expected"),
    [
        ("load", (-0.2, 0.1), True),  # slower up, faster down
        ("load", (-0.2, 0.0), True),
        ("load", (-0.2, -0.19), False),  # slower both ways
        ("thermal_drift", (0.3, 0.0), True),
        ("thermal_drift", (-0.3, 0.0), False),
        ("flow_coupling", (0.3, 0.2), True),
        ("flow_coupling", (0.9, 0.4), False),
        ("gain", (-0.5,), True),
    ],
)
def test_signs_of_the_cause(family, coefficients, expected) -> None:
    assert is_plausible(family, [candidate(family, 0, 1.0, coefficients)]) is expected


def test_a_value_at_its_bound_is_no_name() -> None:
    share = ((("share", None),),)
    inside = {"frequency": 2.0, "damping_ratio": 0.1}
    assert not is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.0,), inside, share))
    assert is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.5,), inside, share))
    overdamped = {"frequency": 2.0, "damping_ratio": 0.9}
    assert is_at_bound(EFFECTS, candidate("oscillation", 0, 1.0, (1.0,), overdamped, share))
    assert not is_at_bound(EFFECTS, candidate("other:position", 0, 1.0, (2.0,)))
