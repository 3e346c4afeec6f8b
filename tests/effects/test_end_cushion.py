"""End cushion: the profile of speed over the distance to the limit."""

import numpy as np
import pytest

from pipeline.effects.end_cushion import EndCushion

from .conftest import LOWER, SETTING, UPPER, signals_at

pytestmark = pytest.mark.usefixtures("float64")

VALUES = {
    "loss_upper": np.array([0.8, 0.5]),
    "loss_lower": np.array([0.4, 0.0]),
    "zone_share": np.array([0.2, 0.1]),
}


@pytest.mark.parametrize("share", np.linspace(-0.05, 1.05, 12))
def test_speed_falls_linearly_towards_a_limit_and_only_towards_it(share):
    q = LOWER + share * (UPPER - LOWER)
    near_upper = np.clip(1 - (1 - share) / VALUES["zone_share"], 0, 1)
    near_lower = np.clip(1 - share / VALUES["zone_share"], 0, 1)
    effect = EndCushion(SETTING)
    _, up = effect.apply(VALUES, (), np.array([0.3, 0.1]), signals_at(q=q))
    _, down = effect.apply(VALUES, (), -np.array([0.3, 0.1]), signals_at(q=q))
    np.testing.assert_allclose(up, [0.3, 0.1] * (1 - VALUES["loss_upper"] * near_upper), rtol=1e-12)
    np.testing.assert_allclose(
        down, -np.array([0.3, 0.1]) * (1 - VALUES["loss_lower"] * near_lower), rtol=1e-12
    )


def test_at_the_limit_the_least_speed_is_left():
    _, v = EndCushion(SETTING).apply(VALUES, (), np.ones(2), signals_at(q=UPPER))
    np.testing.assert_allclose(v, [0.2, 0.5], rtol=1e-12)
