"""Load: a speed ratio per direction, and the slower against the load the more the pose gives it weight."""

import numpy as np
import pytest

from pipeline.effects.load import Load

from .conftest import LOWER, SETTING, UPPER, respond, signals_at

pytestmark = pytest.mark.usefixtures("float64")

VALUES = {
    "mean_speed_ratio_up": np.array([0.9, 1.0]),
    "mean_speed_ratio_down": np.array([1.2, 1.0]),
    "load_slope": np.array([[0.0, 0.2], [0.3, 0.0]]),
}


@pytest.mark.parametrize(
    ("place", "slope"), [((0.0, 0.0), (0.0, 0.0)), ((1.0, -1.0), (-0.2, 0.3)), ((-0.5, 0.5), (0.1, -0.15))]
)
def test_load_is_linear_in_the_place_within_the_ranges(place, slope):
    q = 0.5 * (LOWER + UPPER) + 0.5 * (UPPER - LOWER) * place
    effect = Load(SETTING)
    _, up = effect.apply(VALUES, (), np.array([0.2, 0.1]), signals_at(q=q))
    _, down = effect.apply(VALUES, (), np.array([-0.2, -0.1]), signals_at(q=q))
    np.testing.assert_allclose(up, [0.2, 0.1] * (np.array([0.9, 1.0]) - slope), rtol=1e-12)
    np.testing.assert_allclose(down, -np.array([0.2, 0.1]) * (np.array([1.2, 1.0]) + slope), rtol=1e-12)


def test_at_rest_a_load_moves_nothing():
    assert not respond(Load(SETTING), VALUES, np.zeros((1, 2))).any()
