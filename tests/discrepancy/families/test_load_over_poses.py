"""Mean speed ratios of a load against the wrapper's own ratio on every row."""

import numpy as np

from pipeline.discrepancy.families.load_over_poses import mean_speed_ratios
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.effects.effect import Setting, Signals
from pipeline.effects.load import Load

LOWER, UPPER = np.array([-1.0, 0.0, -2.0]), np.array([1.0, 3.0, 1.0])
SETTING = Setting(0.05, LOWER, UPPER, np.array([0.5, 0.4, 0.3]))
JOINT = 1
FREED = (
    (("mean_speed_ratio_up", None),),
    (("mean_speed_ratio_down", None),),
    *(((("load_slope", source)),) for source in range(3)),
)
COEFFICIENTS = np.array([-0.1, 0.15, 0.05, -0.2, 0.08])


def test_the_means_are_those_of_the_ratio_over_the_rows_that_move_so():
    random = np.random.default_rng(0)
    q = random.uniform(LOWER, UPPER, (500, 3))
    q[:, 2] = 0.8  # far from the middle
    u = 0.4 * random.choice([-1.0, 0.0, 1.0], 500)
    candidate = Candidate("load", JOINT, None, {}, FREED, COEFFICIENTS, 1.0, 0.5, np.ones(1))
    coordinates = [Coordinate(3, None, index, -1.0, 1.0) for index in range(5)]
    factor = random.standard_normal((5, 5))
    covariance = 1e-4 * factor @ factor.T
    found = mean_speed_ratios(candidate, 3, coordinates, covariance, SETTING, q, u, model_error=0.0)

    values = Load(SETTING).neutral()
    values["mean_speed_ratio_up"][JOINT] += COEFFICIENTS[0]
    values["mean_speed_ratio_down"][JOINT] += COEFFICIENTS[1]
    values["load_slope"][JOINT] = COEFFICIENTS[2:]
    moving = np.repeat(u[:, None], 3, axis=1)
    _, ratio = Load(SETTING).ratio(values, (), moving, Signals(np.zeros_like(q), q, np.zeros(500)))
    for name, rows in (("mean_speed_ratio_up", u > 0.0), ("mean_speed_ratio_down", u < 0.0)):
        np.testing.assert_allclose(found[name]["value"], np.mean(np.asarray(ratio)[rows, JOINT]), rtol=1e-5)
        drawn = random.multivariate_normal(COEFFICIENTS, covariance, 20000)
        place = ((q - 0.5 * (UPPER + LOWER)) / (0.5 * (UPPER - LOWER)))[rows].mean(axis=0)
        sign = 1.0 if name.endswith("up") else -1.0
        spread = np.std(drawn[:, 0 if sign > 0 else 1] - sign * drawn[:, 2:] @ place)
        width = np.diff(found[name]["ci95"])[0]
        np.testing.assert_allclose(width, 2 * 1.96 * spread, rtol=0.03)
