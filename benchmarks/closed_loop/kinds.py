"""The kinds of cases that are drawn."""

from collections.abc import Sequence

FAMILIES = (
    "gain",
    "delay",
    "lag",
    "flow_coupling",
    "load",
    "thermal_drift",
    "supply_variation",
    "leakage",
    "backlash",
    "stiction",
    "end_cushion",
    "sensor_bias",
    "timing",
    "oscillation",
)
"""The contract's families that a machine can have from the start; each simulator has a kind of that name for each."""

NULL, PAIR, CHANGE_POINT, IN_NOMINAL, HALF = "null", "pair", "change_point", "in_nominal", "half"


def in_order(outside: Sequence[str]) -> tuple[str, ...]:
    """Every kind of case, given a simulator's kinds that no family describes: their truth is `other`.

    `null` has no effect, `pair` two of different families, `change_point` one that sets in mid-way, `in_nominal` a
    thermal drift that the nominal logs have too, `half` one of any family at half the effect size.
    """
    return (*FAMILIES, NULL, PAIR, CHANGE_POINT, *outside, IN_NOMINAL, HALF)


SETS_IN = tuple(family for family in FAMILIES if family != "thermal_drift")
"""Families of a `change_point`: oil that is warm does not turn cold within a session."""
