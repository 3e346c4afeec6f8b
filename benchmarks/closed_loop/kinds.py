"""The kinds of cases that are drawn."""

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
"""The contract's families that a machine can have from the start; the plant has a kind of the same name for each."""

OUTSIDE = ("pilot_crosstalk", "coil_fade", "hose_kink", "line_clogging", "pilot_supply_sag")
"""The plant's kinds that no family describes: their truth is `other` with what it depends on."""

NULL, PAIR, CHANGE_POINT, IN_NOMINAL, HALF = "null", "pair", "change_point", "in_nominal", "half"

KINDS = (*FAMILIES, NULL, PAIR, CHANGE_POINT, *OUTSIDE, IN_NOMINAL, HALF)
"""Every kind of case.

`null` has no effect, `pair` two of different families, `change_point` one that sets in mid-way, `in_nominal` a
thermal drift that the nominal logs have too, `half` one of any family at half the effect size.
"""

SETS_IN = tuple(family for family in FAMILIES if family != "thermal_drift")
"""Families of a `change_point`: oil that is warm does not turn cold within a session."""
