"""`invert` gives back what `apply` was given, along a sequence with states."""

import numpy as np
import pytest

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.effect import VelocityEffect

from .conftest import SETTING, WRAPPED, respond, rows

# Lost motion inside the gap is not seen, and a resonance is taken for what drives it: their cards say so.
INVERTIBLE = [
    family
    for family in WRAPPED
    if issubclass(KNOWN[family], VelocityEffect) and family not in ("backlash", "oscillation")
]


@pytest.mark.parametrize("family", INVERTIBLE)
def test_the_inverse_undoes_the_effect(family, float64):
    effect = KNOWN[family](SETTING)
    u, signals = rows(21, 50)
    u = u.astype(float)
    v = respond(effect, float64[family], u, signals)
    assert np.abs(v - u).max() > 1e-4
    found = respond(effect, float64[family], v, signals, "invert")
    np.testing.assert_allclose(found, u, atol=1e-3 * SETTING.speed_scale.max())


def test_a_chain_is_inverted_in_reversed_order(float64):
    names = ["gain", "lag", "leakage", "load", "end_cushion"]
    chain = Chain([KNOWN[name] for name in names], SETTING)
    u, signals = rows(22, 30)
    state = inverse = chain.initial(())
    for t in range(30):
        row = type(signals)(*(array[t] for array in signals))
        state, v = chain.velocity(float64, state, u[t].astype(float), row)
        inverse, found = chain.nominal_velocity(float64, inverse, v, row)
        np.testing.assert_allclose(found, u[t], atol=1e-9)
