"""Causes that several joints have in common: they compete as one, by what they explain on all joints together."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence

from pipeline.discrepancy.families.late_channel import late_channel
from pipeline.discrepancy.families.plausibility import (
    ACTIVITY,
    CHANNEL,
    DEAD_BAND,
    DELAY,
    FLOW_COUPLING,
    LOAD,
    THERMAL_DRIFT,
    TIMING,
    is_plausible,
)
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.selection.candidate import Candidate

COMMON_CAUSES = (THERMAL_DRIFT, SUPPLY, ACTIVITY, CHANNEL)
WHOLE_MACHINE = (THERMAL_DRIFT, TIMING, SUPPLY, ACTIVITY, CHANNEL, FLOW_COUPLING)
ON_SEVERAL_JOINTS = (FLOW_COUPLING, LOAD, DEAD_BAND)  # one pump, one payload, one controller of all valves
OF_ONE_CAUSE = tuple(dict.fromkeys((*WHOLE_MACHINE, *ON_SEVERAL_JOINTS)))  # on however many joints they show
COMMON_FACTOR = 1.3  # times what the best effect on one joint explains
RIVAL_SHARE = 0.7  # of what the best explains on its joint
# A cause with an equation comes before a dependence, and both before one that nobody can observe. A payload's slopes
# over all positions fit something of any slow change: it has to explain clearly more than other causes in common.
COMMON_PENALTY = {ACTIVITY: 1.1, LOAD: 1.2, SUPPLY: 1.25}


def of_one_cause(candidates: Sequence[Candidate], excited: Collection[int]) -> list[str]:
    """Families whose members on several joints are one cause, delays among them where the channel is late.

    Args:
        candidates: That were found.
        excited: Joints that move enough to tell.
    """
    count = Counter(c.family for c in candidates)
    families = [family for family in OF_ONE_CAUSE if count[family] > 1]
    if late_channel([c for c in candidates if c.family == DELAY], excited):
        families.append(DELAY)
    return families


def common_causes(
    best: Candidate,
    candidates: Sequence[Candidate],
    net: Callable[[Candidate], float],
    shows: Callable[[Candidate], bool],
) -> list[list[Candidate]]:
    """The causes that explain so much more on all their joints together than the best candidate does on one.

    Args:
        best: Of all candidates, by itself.
        candidates: All of them.
        net: What a candidate explains.
        shows: Whether a candidate can be seen on its joint.

    Returns:
        The likeliest first; each on every joint on which it shows, the clearest first.
    """
    options: list[tuple[float, list[Candidate]]] = []
    for family, source in dict.fromkeys((c.family, c.source) for c in candidates):
        if family not in (*COMMON_CAUSES, *ON_SEVERAL_JOINTS):
            continue
        members = [c for c in candidates if (c.family, c.source) == (family, source)]
        showing = [c for c in members if shows(c)]
        if len(showing) < 2 or not is_plausible(family, showing):
            continue
        here = next((c for c in members if c.joint == best.joint), None)
        joints = {c.joint for c in showing}
        is_rival = here is None or here.joint not in joints or here.gain > RIVAL_SHARE * best.gain
        total = sum(net(c) for c in showing)
        if is_rival and total > COMMON_FACTOR * net(best):
            options.append((total * worth_of(family), sorted(showing, key=net, reverse=True)))
    return [showing for _, showing in sorted(options, key=lambda option: -option[0])]


def worth_of(family: str) -> float:
    """The factor on what a common cause explains by which it is compared with other causes in common."""
    return 1.0 / COMMON_PENALTY.get(family, 1.0)
