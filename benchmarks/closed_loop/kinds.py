"""The kinds of cases, and how they are drawn by lot."""

from collections.abc import Sequence

import numpy as np

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

NULL, NOMINAL_RANGE = "null", "nominal_range"
PAIR, TRIPLE, CHANGE_POINT, RAMP, IN_NOMINAL = "pair", "triple", "change_point", "ramp", "in_nominal"

WITHOUT_EFFECT = (NULL, NOMINAL_RANGE)
"""Nothing, or a payload between those of the nominal sessions. Half of both have another operator."""

N_EFFECT = {PAIR: 2, TRIPLE: 3}
"""Effects of different families at once."""

SETS_IN = tuple(family for family in FAMILIES if family != "thermal_drift")
"""Families of a change point or a ramp: oil that is warm does not turn cold within a session."""

SINGLE_SHARE = (
    0.5  # of the cases with catalogue effects that have one from the start; the other kinds share the rest
)


def in_order(outside: Sequence[str]) -> tuple[str, ...]:
    """Every kind of case, given a simulator's kinds that no family describes: their truth is `other`."""
    return (*FAMILIES, PAIR, TRIPLE, CHANGE_POINT, RAMP, IN_NOMINAL, *outside, *WITHOUT_EFFECT)


def lot(random: np.random.Generator, number: int, outside: Sequence[str]) -> str:
    """The kind of a case. Of three numbers in turn one is without effect, one outside the catalogue."""
    if number % 3 == 0:
        return str(random.choice(WITHOUT_EFFECT))
    if number % 3 == 1:
        return str(random.choice(outside))
    if random.random() < SINGLE_SHARE:
        return str(random.choice(FAMILIES))
    return str(random.choice((PAIR, TRIPLE, CHANGE_POINT, RAMP, IN_NOMINAL)))


def effects_of(random: np.random.Generator, kind: str) -> list[str]:
    """The simulator's kinds of effects that a case of `kind` has."""
    if kind in WITHOUT_EFFECT:
        return []
    if kind in (CHANGE_POINT, RAMP):
        return [str(random.choice(SETS_IN))]
    if kind == IN_NOMINAL:
        return ["thermal_drift"]
    if kind in N_EFFECT:
        return [str(family) for family in random.choice(FAMILIES, N_EFFECT[kind], replace=False)]
    return [kind]
