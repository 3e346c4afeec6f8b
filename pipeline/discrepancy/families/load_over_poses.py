"""What a load does in the mean over the poses of the logs; the wrapper's ratios are those in the middle of the range.

The ratio is linear in the wrapper's coefficients, so its mean over poses is, too: 1 + g · c.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.families.contract_parameters import Quantity, quantity
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.effects.effect import Setting

MOVING_SHARE = 0.3  # of the usual speed


def mean_speed_ratios(
    candidate: Candidate,
    number: int,
    coordinates: Sequence[Coordinate],
    covariance: np.ndarray,
    setting: Setting,
    q: np.ndarray,
    u: np.ndarray,
    model_error: float,
) -> dict[str, Quantity]:
    """`mean_speed_ratio_up` and `mean_speed_ratio_down` over the rows in which the joint moves so.

    Args:
        candidate: A `load` on one joint.
        number: Of the effect, in the coordinates.
        coordinates: Of the joint.
        covariance: Of the coordinates.
        setting: Of the machine.
        q: (N, n_joint) configurations, rad or m.
        u: (N,) velocity of the joint that the diagnosis model predicts without the effect.
        model_error: Share of a change by which the idealised effect may differ from the real one.
    """
    middle, half = 0.5 * (setting.upper + setting.lower), 0.5 * (setting.upper - setting.lower)
    place = (q - middle) / half
    speed = setting.speed_scale[candidate.joint]
    rows = [k for k, coordinate in enumerate(coordinates) if coordinate.effect == number]
    order = [coordinates[k].index for k in rows]
    result = {}
    for name, sign in (("mean_speed_ratio_up", 1.0), ("mean_speed_ratio_down", -1.0)):
        moving = sign * u > MOVING_SHARE * speed
        mean = place[moving].mean(axis=0) if moving.any() else np.zeros(place.shape[1])
        gradient = np.array(
            [
                -sign * mean[of[0][1]] if of[0][0] == "load_slope" else float(of[0][0] == name)
                for of in candidate.freed
            ]
        )
        change = float(gradient @ candidate.coefficients)
        along = gradient[order]
        variance = float(along @ covariance[np.ix_(rows, rows)] @ along)
        result[name] = quantity(
            1.0 + change, "1", float(np.hypot(np.sqrt(max(variance, 0.0)), model_error * change))
        )
    return result
