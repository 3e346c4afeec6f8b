"""Delay: the command of some time ago, linear between steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.command_buffer import LONGEST_STEPS
from pipeline.effects.delay import Delay

from .conftest import DT_S, SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.125, 0.31, 0.8])
def test_commands_are_shifted_with_linear_interpolation(delay_s):
    a = rows(1, 60)[1].command.astype(float)
    late = respond(Delay(SETTING), {"added_delay": np.array([delay_s, 0.05])}, a)
    t_s = DT_S * np.arange(60)
    np.testing.assert_allclose(late[:, 0], np.interp(t_s - delay_s, t_s, a[:, 0], left=0.0), atol=1e-12)
    np.testing.assert_allclose(late[:, 1], np.interp(t_s - 0.05, t_s, a[:, 1], left=0.0), atol=1e-12)


def test_delays_end_at_the_buffers_length():
    a = rows(2, 40)[1].command.astype(float)
    longest = LONGEST_STEPS * DT_S
    late = respond(Delay(SETTING), {"added_delay": np.array([longest + 1.0, -1.0])}, a)
    np.testing.assert_allclose(late[LONGEST_STEPS:, 0], a[:-LONGEST_STEPS, 0], atol=1e-12)
    np.testing.assert_allclose(late[:, 1], a[:, 1], atol=1e-12)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_at_whole_steps_the_derivative_is_that_towards_longer_delays(steps):
    a = np.random.default_rng(3).uniform(-1, 1, (12, 2))
    effect = Delay(SETTING)

    def late(delay_s):
        state = effect.initial(())
        for row in jnp.asarray(a):
            state, output = effect.apply({"added_delay": jnp.stack([delay_s, delay_s])}, state, row)
        return output

    slope = jax.jacfwd(late)(jnp.asarray(steps * DT_S))
    np.testing.assert_allclose(slope, (a[-2 - steps] - a[-1 - steps]) / DT_S, atol=1e-9)
