"""Sizes that are none: what the interval of an effect's size, misfit included, cannot tell from no effect at all.

A small change that many rows show is beyond chance, and beyond every placebo, where it is but the model's own misfit.
Of a supply it is not its size that tells, but on how many joints and for how long its change of speed is the same.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.discrepancy.families.plausibility import BACKLASH, DELAY, FLOW_COUPLING, LAG, LEAKAGE, STICTION
from pipeline.discrepancy.families.shared_flow import LOSS
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import SHORTEST_S
from pipeline.effects.draws import OF_95_PERCENT

WITHIN = "within what the diagnosis model is off by on nominal logs"
# By the first that is there: of a stiction told by when joints start, the wrapper's own value stands beside; of a lag
# the wrapper's own is as wide as the logs leave it, and not also as wide as what it means for a valve.
SIZES = {
    BACKLASH: ("width",),
    DELAY: ("added_delay",),
    LAG: ("added_time_constant_starting", "added_time_constant"),
    LEAKAGE: ("sag_rate",),
    STICTION: ("mean_extra_time_of_command", "mean_extra_time"),
    FLOW_COUPLING: (LOSS,),
    SUPPLY: ("correlation_time",),
}


def why_it_is_none(
    family: str, parameters: Mapping[str, Any], smallest_deviations: float, joints: Sequence[int]
) -> str | None:
    """Why it may be but what the diagnosis model is off by on nominal logs, in a clause; None: it is beyond that.

    What joints take from each other's flow has to be some standard deviations: with more joints at once than nominal
    logs show, what the diagnosis model makes of them beats every placebo. A supply changes the speed of every joint,
    and for longer than the model is off alike where joints start and stop together.

    Args:
        family: Of the effect, one of `SIZES`.
        parameters: As in `closed_loop.json`.
        smallest_deviations: Of a shared flow's loss.
        joints: That have it.
    """
    name = next(name for name in SIZES[family] if name in parameters)
    if family == SUPPLY:
        if len(joints) < 2:
            return "all joints have a supply in common, and one alone shows this"
        time = parameters[name]
        if time["value"] >= SHORTEST_S:
            return None
        return (
            f"a {name} of {time['value']:.2g} {time['unit']} is that of joints which start and stop together"
        )
    if family == FLOW_COUPLING:
        loss = parameters[LOSS]
        deviation = (loss["ci95"][1] - loss["value"]) / OF_95_PERCENT
        if loss["value"] >= smallest_deviations * deviation:
            return None
        return f"a loss of {loss['value']:.0%} ± {deviation:.0%} is {WITHIN}"
    lower, upper = parameters[name]["ci95"]
    if not lower <= 0.0 <= upper:
        return None
    told = f"{parameters[name]['value']:.2g} ({lower:.2g} to {upper:.2g}) {parameters[name]['unit']}"
    return f"{name} of {told} is {WITHIN}"
