"""Speeds that vary without an equation are followed: the filter of `effects.varying_speed`, fitted to measured logs.

An estimate depends on how the process compares with the noise, and on how long it lasts. Both are tried by factors of
three, between which the error of a filter changes little. The pair with the smallest open-loop error on the rows for
fitting and selection is kept, if it beats no filter.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.selection.grouping import MachineEffect

STD = (0.01, 0.03, 0.1, 0.3)  # of z, beside the model's error over one step
TIMES_S = (2.0, 6.0, 20.0, 60.0)

FilterValues = Mapping[str, np.ndarray]
"""Of `VaryingSpeed`, by parameter, (n_joint,)."""


def filters_of(effects: Sequence[MachineEffect], noise: np.ndarray) -> list[FilterValues]:
    """Every filter that is tried for effects without an equation; none if there are no such effects.

    Args:
        effects: Of the verdict. A supply is common to its joints, a course in time each joint's own.
        noise: (n_joint,) the model's error over one step on the machine as it was, rad or m.
    """
    common, own = np.zeros((2, len(noise)))
    for effect in effects:
        if not effect.has_wrapper:
            (common if effect.family == SUPPLY else own)[effect.joints] = 1.0
    if not (common.any() or own.any()):
        return []
    return [
        {
            "common_std": std * common,
            "own_std": std * own,
            "time_constant": np.full(len(noise), time_s),
            "noise": noise,
        }
        for std, time_s in product(STD, TIMES_S)
    ]


def best_filter(
    tried: Sequence[FilterValues], errors: Callable[[FilterValues], WindowErrors], without: WindowErrors
) -> FilterValues | None:
    """The filter with the smallest open-loop error, joints scaled alike; None if none beats no filter.

    Args:
        tried: At least one.
        errors: Of the model with a filter, on the rows for fitting and selection.
        without: Of the model without.
    """
    if not len(without.squares):
        return None
    scale = np.maximum(without.squares.mean(axis=0), 1e-18)
    loss = [float(np.mean(errors(of).squares.mean(axis=0) / scale)) for of in tried]
    best = int(np.argmin(loss))
    return tried[best] if loss[best] < 1.0 else None
