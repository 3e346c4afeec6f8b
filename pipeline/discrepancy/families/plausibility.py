"""What speaks for one name and against another before any data: how much a family can fit, and which values mean it."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.discrepancy.families.shared_flow import is_shared
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import WIDTHS_S
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.effect import Effect

THERMAL_DRIFT, FLOW_COUPLING, LOAD = "thermal_drift", "flow_coupling", "load"
ACTIVITY, CHANNEL, DEAD_BAND = "other:activity", "other:channel", "other:dead_band"
GAIN, TIMING = "gain", "timing"
SENSOR_BIAS, BACKLASH, DELAY = "sensor_bias", "backlash", "delay"
STICTION, OSCILLATION, LAG, LEAKAGE = "stiction", "oscillation", "lag", "leakage"
# Of the larger change: a load speeds up one direction by as much of what it takes from the other, a gain does not.
OPPOSED = 0.3
MEAN_SQUARE_OF_THE_RANGE = 1.0 / 3.0  # of positions in [-1, 1], all alike
LATE_S = 0.1  # two steps: a cold lag that loses travel, whatever the speeds do
AT_BOUND = 0.01  # of the range between the bounds

WITHOUT_CARD = {SUPPLY: 4.0, COURSE: 6.0}  # complexity: a course in time fits more than any equation
TWO_WAYS_COMPLEXITY, ONSET_COMPLEXITY = 2.8, 0.6  # more: of a gain that differs by direction, of an onset


def complexity(candidate: Candidate) -> float:
    """How much a candidate can fit; an onset is one choice more."""
    of_card = WITHOUT_CARD.get(candidate.family) or KNOWN[candidate.family].card.complexity
    two_ways = TWO_WAYS_COMPLEXITY * (candidate.family == GAIN and len(candidate.freed) > 1)
    return of_card + two_ways + ONSET_COMPLEXITY * (candidate.onset is not None)


def is_dependence(candidate: Candidate) -> bool:
    """Whether it names no cause: the contract's family `other`."""
    return candidate.family.startswith("other")


def depends_alike(dependence: Candidate, name: Candidate) -> bool:
    """Whether a dependence is on the very variable of the very joint that the name on that joint depends on."""
    if dependence.family not in DEPENDENCES or not has_wrapper(name):
        return False
    source = dependence.joint if dependence.source is None else dependence.source
    entry = f"{DEPENDENCES[dependence.family].variable}:{{joint}}"
    return source == name.joint and entry in KNOWN[name.family].card.depends_on


def is_plausible(family: str, showing: Sequence[Candidate]) -> bool:
    """Whether the signs are those of the cause on most of the joints, counted by what it explains there.

    Oil that warms up makes faster, leaves a machine that is not much slower than nominal once it is warm, and begins
    with one that is not faster; a load makes a joint slower one way and faster the other, which no wear of its actuator
    does; a small pump shows where joints move at once; a supply varies more slowly than joints start and stop, which is
    where models are off alike.
    """
    if family == THERMAL_DRIFT:
        is_right = [_is_worse_when_cold(c) for c in showing]
    elif family == LOAD:
        is_right = [_is_opposed(c) for c in showing]
    elif family == GAIN:
        is_right = [len(c.freed) < 2 or not _is_opposed(c) for c in showing]
    elif family == FLOW_COUPLING:
        is_right = [is_shared(c) for c in showing]
    elif family == SUPPLY:
        is_right = [c.point["width"] > WIDTHS_S[0] for c in showing]
    else:
        return True
    gains = np.array([c.gain for c in showing])
    return bool(gains @ is_right > 0.5 * gains.sum())


def _is_worse_when_cold(candidate: Candidate) -> bool:
    """Whether cold oil makes the joint slower than it is for good, or late."""
    is_slow = candidate.coefficient_of("cold_speed_loss") > abs(candidate.coefficient_of("warm_gain"))
    return is_slow or candidate.coefficient_of("cold_lag") > LATE_S


def _is_opposed(candidate: Candidate) -> bool:
    """Whether a joint is slower one way and faster the other, in the mean square over the range of all joints.

    Coefficients begin with those of both ways in the middle of the range; slopes with the pose, as a load has, are of
    opposite sign by its equation.
    """
    both_ways, slopes = candidate.coefficients[:2], candidate.coefficients[2:]
    alike = abs(float(both_ways.sum())) / 2.0
    opposed = np.sqrt((np.ptp(both_ways) / 2.0) ** 2 + np.sum(slopes**2) * MEAN_SQUARE_OF_THE_RANGE)
    return bool(2.0 * opposed > (1.0 + OPPOSED) * (alike + opposed))


def is_at_bound(effects: Mapping[str, Effect], candidate: Candidate) -> bool:
    """Whether a named effect fits only with a value at the edge of what is plausible: then it is another."""
    if candidate.family in DEPENDENCES or not has_wrapper(candidate):
        return False
    effect = effects[candidate.family]
    by_name = {p.name: p for p in effect.card.parameters}
    values = list(candidate.point.items())
    for freed, coefficient in zip(candidate.freed, candidate.coefficients, strict=True):
        name = freed[0][0]
        values.append((name, by_name[name].neutral + float(coefficient)))
    for name, value in values:
        parameter = by_name[name]
        if parameter.natural_bounds:
            continue
        size = effect.sizes(name)[candidate.joint]
        lower, upper = size * parameter.lower, size * parameter.upper
        margin = AT_BOUND * (upper - lower)
        if value > upper - margin or 0.0 != lower > value - margin:
            return True
    return False
