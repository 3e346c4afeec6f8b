"""What speaks for one name and against another before any data: how much a family can fit, and which values mean it."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.screen import Candidate
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.effect import Effect

THERMAL_DRIFT, FLOW_COUPLING, LOAD = "thermal_drift", "flow_coupling", "load"
DEAD_BAND, TIMING = "other:dead_band", "timing"
SENSOR_BIAS, BACKLASH, DELAY, OSCILLATION = "sensor_bias", "backlash", "delay", "oscillation"
APART = 0.8  # of the larger change: by so much the two directions differ under a load
AT_BOUND = 0.01  # of the range between the bounds

# From the simplest to the most general; a named family that says as much is preferred to one that says less.
COMPLEXITY = {
    "gain": 1.0,
    "delay": 1.0,
    "leakage": 1.0,
    "backlash": 1.2,
    "lag": 1.0,
    "sensor_bias": 1.3,
    "stiction": 1.5,
    "end_cushion": 2.0,
    "flow_coupling": 2.5,
    "oscillation": 2.5,
    "thermal_drift": 2.5,
    DEAD_BAND: 2.5,
    "load": 3.0,
    SUPPLY: 4.0,
}
OTHER_COMPLEXITY = 5.0


def complexity(candidate: Candidate) -> float:
    """How much a candidate can fit; an onset is one choice more."""
    two_ways = 2.8 * (candidate.family == "gain" and len(candidate.freed) > 1)
    return COMPLEXITY.get(candidate.family, OTHER_COMPLEXITY) + two_ways + 0.6 * (candidate.onset is not None)


def is_dependence(candidate: Candidate) -> bool:
    """Whether it names no cause: the contract's family `other`."""
    return candidate.family.startswith("other")


def is_plausible(family: str, showing: Sequence[Candidate]) -> bool:
    """Whether the signs are those of the cause on most joints.

    Oil that warms up makes faster; a joint that is slower both ways carries no load; nothing loses more than all of its
    speed to others.
    """
    if family == THERMAL_DRIFT:
        is_right = [c.coefficients[0] > 0.0 for c in showing]
    elif family == LOAD:
        both_ways = [c.coefficients[:2] for c in showing]
        is_right = [np.ptp(of_joint) > APART * np.abs(of_joint).max() for of_joint in both_ways]
    elif family == FLOW_COUPLING:
        is_right = [c.coefficients.sum() < 1.0 for c in showing]
    else:
        return True
    return int(np.sum(is_right)) > 0.5 * len(showing)


def is_at_bound(effects: Mapping[str, Effect], candidate: Candidate) -> bool:
    """Whether a named effect fits only with a value at the edge of what is plausible: then it is another."""
    if candidate.family in DEPENDENCES or candidate.family == SUPPLY:
        return False
    by_name = {p.name: p for p in effects[candidate.family].card.parameters}
    values = list(candidate.point.items())
    for freed, coefficient in zip(candidate.freed, candidate.coefficients, strict=True):
        name = freed[0][0]
        values.append((name, by_name[name].neutral + float(coefficient)))
    for name, value in values:
        parameter = by_name[name]
        if parameter.natural_bounds:
            continue
        margin = AT_BOUND * (parameter.upper - parameter.lower)
        if value > parameter.upper - margin or 0.0 != parameter.lower > value - margin:
            return True
    return False


def say_the_same(one: Candidate, other: Candidate) -> bool:
    """Whether naming both would say nothing.

    `timing` is the delay of all joints: on one joint alone they are the same wrapper. An encoder's offset changes no
    speed, but for the little that speeds depend on the place: it is no other reading of a gain.
    """
    families = {one.family, other.family}
    offset = any(c.family == SENSOR_BIAS and "offset" in c.point for c in (one, other))
    return families == {"delay", "timing"} or (families == {"gain", SENSOR_BIAS} and offset)
