"""The parameters that a wrapper is linear in: which of a dependence there are, how they move, and within what."""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.simulation import Values
from pipeline.effects.dependence import N_DIRECTION, Dependence
from pipeline.effects.effect import Effect, Freed, Variant

WIDEST = 2.0  # coefficient of a dependence, either way
USUAL_SHARE = 0.1  # of what is plausible: a coefficient is about zero within it, before any row is seen


def freed_of(dependence: Dependence, source: int) -> Variant:
    """All coefficients of a dependence on one joint, or on the machine."""
    return tuple(
        (("coefficients", (direction, source, k)),)
        for direction in range(N_DIRECTION)
        for k in range(dependence.n_basis)
        if k != dependence.reference
    )


def direction_of(family: str, effect: Effect, freed: Freed, joints: Sequence[int]) -> Values:
    """Change of the values by one unit of what is freed, on joints."""
    of = {name: np.zeros_like(value) for name, value in effect.neutral().items()}
    for name, index in freed:
        for joint in joints:
            of[name][(joint,) if index is None else (joint, *np.atleast_1d(index))] = 1.0
    return {family: of}


def bounds_of(effect: Effect, variant: Variant) -> tuple[np.ndarray, np.ndarray]:
    """(k,) lower and upper bounds of coefficients, which are changes from neutral values."""
    if isinstance(effect, Dependence):
        return np.full(len(variant), -WIDEST), np.full(len(variant), WIDEST)
    by_name = {parameter.name: parameter for parameter in effect.card.parameters}
    freed = [by_name[one[0][0]] for one in variant]
    return (
        np.array([parameter.lower - parameter.neutral for parameter in freed]),
        np.array([parameter.upper - parameter.neutral for parameter in freed]),
    )
