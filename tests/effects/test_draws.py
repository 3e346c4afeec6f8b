"""Draws of effects' values: their spread, their ends, and what no log leaves open."""

from dataclasses import replace

import jax
import numpy as np

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.draws import EffectDraws
from pipeline.effects.store import ActiveEffects

from .conftest import SETTING, VALUES

N = 2000


def drawn(effects):
    keys = jax.random.split(jax.random.key(0), N)
    return jax.device_get(jax.jit(jax.vmap(EffectDraws(effects).draw))(keys))


def test_draws_spread_as_far_as_logs_leave_a_value_open():
    deviations = {"delay": {"added_delay": np.array([0.02, 0.0])}, "gain": {"ratio_negative": [0.3, 0.05]}}
    effects = ActiveEffects(SETTING, {f: VALUES[f] for f in ("delay", "gain")}, {}, deviations)
    of = drawn(effects)
    delay = of["delay"]["added_delay"]
    np.testing.assert_array_equal(delay[:, 1], np.float32(VALUES["delay"]["added_delay"][1]))
    np.testing.assert_allclose(delay[:, 0].mean(), VALUES["delay"]["added_delay"][0], atol=2e-3)
    half = np.abs(delay[:, 0] - VALUES["delay"]["added_delay"][0]).max()
    assert 1.9 < half / 0.02 < 1.97  # cut off at the 95 % interval
    ratio = of["gain"]["ratio_negative"]
    assert ratio[:, 0].min() == np.float32(0.2)  # of the card: 0.7 - 1.96 * 0.3 lies beyond
    assert abs(np.corrcoef(ratio[:, 1], delay[:, 0])[0, 1]) < 0.1
    assert ratio.std(axis=0)[1] > 0.04


def test_without_deviations_every_draw_is_the_value():
    values = {family: VALUES[family] for family in ("lag", "other:position", "load")}
    values["stiction"] = KNOWN["stiction"](SETTING).neutral()  # not active
    effects = ActiveEffects(SETTING, values, {})
    assert EffectDraws(effects).is_certain
    assert not EffectDraws(replace(effects, deviations={"lag": {"fall_share": np.ones(2)}})).is_certain
    of = drawn(effects)
    assert set(of) == {"lag", "other:position", "load"}
    for family in of:
        for name, value in of[family].items():
            assert (value == np.float32(VALUES[family][name])).all()
