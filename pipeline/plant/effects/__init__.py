"""Undeclared effects: one file per kind, each a change of a physical quantity of the plant, drawn by seed.

Families are those of the contract's effect table. `other` has several kinds that the table does not
describe. Nothing here may be imported by anything that identifies effects.
"""

from collections.abc import Callable

import numpy as np

from pipeline.errors import InputError
from pipeline.plant.effects import (
    backlash,
    coil_fade,
    delay,
    end_cushion,
    flow_coupling,
    gain,
    hose_kink,
    lag,
    leakage,
    line_clogging,
    load,
    oscillation,
    pilot_crosstalk,
    pilot_supply_sag,
    sensor_bias,
    stiction,
    supply_variation,
    thermal_drift,
    timing,
)
from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.parameters import Parameters

Draw = Callable[[np.random.Generator, Parameters, float], PlantEffect]

KINDS: dict[str, Draw] = {
    "gain": gain.draw,
    "delay": delay.draw,
    "lag": lag.draw,
    "flow_coupling": flow_coupling.draw,
    "load": load.draw,
    "thermal_drift": thermal_drift.draw,
    "supply_variation": supply_variation.draw,
    "leakage": leakage.draw,
    "backlash": backlash.draw,
    "stiction": stiction.draw,
    "end_cushion": end_cushion.draw,
    "sensor_bias": sensor_bias.draw,
    "timing": timing.draw,
    "oscillation": oscillation.draw,
    "pilot_crosstalk": pilot_crosstalk.draw,
    "coil_fade": coil_fade.draw,
    "hose_kink": hose_kink.draw,
    "line_clogging": line_clogging.draw,
    "pilot_supply_sag": pilot_supply_sag.draw,
}
"""Every kind of effect by name; the last five are of family `other`."""


def draw(kind: str, seed: int, nominal: Parameters, size: float) -> PlantEffect:
    """An effect of one kind, drawn by seed.

    Args:
        kind: one of `KINDS`.
        seed: of joint, direction and strength.
        nominal: the machine that the effect will change; its truth is measured on it.
        size: strength; 1 is a plain effect, 0.5 half of it.

    Raises:
        InputError: the kind is unknown, or the size is not positive.
    """
    if kind not in KINDS:
        raise InputError(
            f"effect {kind!r} is not known to the plant; choose one of {', '.join(sorted(KINDS))}"
        )
    if not size > 0.0:
        raise InputError(f"effect {kind}: size is {size}; it must be positive")
    return KINDS[kind](np.random.default_rng(seed), nominal, size)


__all__ = ["KINDS", "PlantEffect", "Quantity", "draw"]
