"""Chains: order, whole logs against steps, batch axes against loops, and effects that set in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain, set_in
from pipeline.effects.effect import Signals

from .conftest import SETTING, VALUES, WRAPPED, rows

SINGLE = jax.tree.map(lambda value: np.asarray(value, np.float32), VALUES)

HALVES = [WRAPPED[::2], WRAPPED[1::2]]


def chain_of(*names: str) -> Chain:
    return Chain([KNOWN[name] for name in names], SETTING)


def test_effects_act_by_place_and_then_by_name():
    found = list(
        chain_of("sensor_bias", "backlash", "oscillation", "load", "leakage", "lag", "gain", "delay").effects
    )
    assert found == ["delay", "gain", "load", "lag", "oscillation", "leakage", "backlash", "sensor_bias"]


def test_places_follow_each_other_in_hand_numbers():
    chain = chain_of("leakage", "gain")  # first the ratio, then the creep
    values = {
        "gain": {"ratio_positive": np.full(2, 2.0), "ratio_negative": np.ones(2)},
        "leakage": chain.effects["leakage"].neutral() | {"sag_rate": np.full(2, 0.125)},
    }
    signals = Signals(jnp.zeros(2), jnp.zeros(2), jnp.zeros(()))
    _, v = chain.velocity(values, chain.initial(()), jnp.array([0.25, -0.25]), signals)
    np.testing.assert_array_equal(v, [0.625, -0.125])


@pytest.mark.parametrize("names", [WRAPPED, ["gain", "load"], []], ids=["all", "stateless", "none"])
def test_a_whole_log_equals_its_steps(names):
    chain = chain_of(*names)
    u, signals = rows(41, 60)

    @jax.jit
    def step(state, row):
        u, signals = row
        state, command = chain.commands(SINGLE, state, signals.command)
        state, v = chain.velocity(SINGLE, state, u, signals)
        return state, (command, v)

    _, (command, v) = jax.lax.scan(step, chain.initial(()), (u, signals))
    np.testing.assert_allclose(
        chain.command_sequence(SINGLE, jnp.asarray(signals.command)), command, atol=1e-6
    )
    np.testing.assert_allclose(chain.velocity_sequence(SINGLE, jnp.asarray(u), signals)[0], v, atol=1e-6)


@pytest.mark.parametrize("names", HALVES)
def test_batch_axes_equal_a_loop(names):
    chain = chain_of(*names)
    u, signals = rows(42, 25, batch=(2, 3))

    @jax.jit
    def outputs(u, signals):
        command = chain.command_sequence(SINGLE, signals.command)
        return command, chain.velocity_sequence(SINGLE, u, signals)[0], chain.measured(SINGLE, signals.q)

    together = outputs(jnp.asarray(u), signals)
    for place in np.ndindex(2, 3):
        alone = outputs(*jax.tree.map(lambda array, place=place: array[(slice(None), *place)], (u, signals)))
        for found, expected in zip(together, alone, strict=True):
            np.testing.assert_allclose(found[(slice(None), *place)], expected, atol=1e-6)


@pytest.mark.parametrize("names", HALVES)
def test_values_may_have_the_batch_axes_too(names):
    """As they do when windows start before and after an onset."""
    chain = chain_of(*names)
    neutral = chain.neutral()
    values = {family: jax.tree.map(jnp.asarray, SINGLE[family]) for family in names}
    share = dict.fromkeys(names, jnp.array([[0.0, 0.0], [1.0, 1.0], [0.5, 1.0]]))
    present = set_in(values, neutral, share)
    u, signals = rows(43, 3)  # one row per share

    @jax.jit
    def outputs(values, batch_signals, u):
        state = chain.initial(u.shape[:-1])
        state, command = chain.commands(values, state, batch_signals.command)
        state, v = chain.velocity(values, state, u, batch_signals)
        _, nominal = chain.nominal_velocity(values, chain.initial(u.shape[:-1]), u, batch_signals)
        return command, v, nominal, chain.measured(values, batch_signals.q)

    together = outputs(present, signals, jnp.asarray(u))
    for n in range(3):
        own = jax.tree.map(lambda value, n=n: value[n], present)
        alone = outputs(own, Signals(*(array[n] for array in signals)), jnp.asarray(u[n]))
        for found, expected in zip(together, alone, strict=True):
            np.testing.assert_allclose(found[n], expected, atol=1e-6)


def test_share_of_onset_goes_from_neutral_to_the_values():
    values = {
        "gain": {"ratio_positive": jnp.array([2.0, 0.5])},
        "lag": {"added_time_constant": jnp.array([0.3, 0.1])},
        "flow_coupling": {"loss_fraction": jnp.array([[0.0, 0.4], [0.2, 0.0]])},
    }
    neutral = {
        "gain": {"ratio_positive": np.ones(2)},
        "lag": {"added_time_constant": np.zeros(2)},
        "flow_coupling": {"loss_fraction": np.zeros((2, 2))},
    }
    share = {
        "gain": jnp.array([[0.0, 0.0], [0.5, 1.0], [1.0, 0.5]]),
        "flow_coupling": jnp.array([[0.0, 0.5], [1.0, 0.0]]),
    }
    present = set_in(values, neutral, share)
    np.testing.assert_allclose(present["gain"]["ratio_positive"], [[1, 1], [1.5, 0.5], [2, 0.75]])
    # Of a joint's row by source, the whole row: the joint comes first.
    by_source = [[[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.4], [0.0, 0.0]]]
    np.testing.assert_allclose(present["flow_coupling"]["loss_fraction"], by_source)
    assert present["lag"] is values["lag"]
