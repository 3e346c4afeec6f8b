"""A gain beside a dependence that counts from a place where nothing is changed: both are the dependence.

A joint that is slower wherever another one stands beyond some place is slower in most of the logs, which a gain
explains first. What is left then depends on the place: elsewhere the joint is faster than that gain. It has none.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.candidate import Candidate
from pipeline.discrepancy.found import Found
from pipeline.discrepancy.plausibility import GAIN
from pipeline.effects.dependence import DEPENDENCES, N_DIRECTION
from pipeline.effects.effect import Freed

NAMES = ("ratio_negative", "ratio_positive")  # in the order of a dependence's directions


def with_its_gain(found: Sequence[Found]) -> list[Found]:
    """The effects, a gain taken into the dependence on its joint that counts from a reference, if there is one."""
    result = list(found)
    for gain in found:
        if gain.candidate.family != GAIN or gain.candidate.onset is not None:
            continue
        place = next((i for i, f in enumerate(result) if _takes(f.candidate, gain.candidate)), None)
        if place is not None:
            dependence = result[place]
            told = [*dependence.losers, (gain.candidate, "leaves what depends on a place behind")]
            result[place] = replace(
                dependence, candidate=_together(dependence.candidate, gain.candidate), losers=told
            )
            result.remove(gain)
    return result


def _takes(candidate: Candidate, gain: Candidate) -> bool:
    card = DEPENDENCES.get(candidate.family)
    return card is not None and card.reference is not None and candidate.joint == gain.joint


def _together(dependence: Candidate, gain: Candidate) -> Candidate:
    """The dependence, by what it and the gain make of the speed at the reference and elsewhere."""
    card = DEPENDENCES[dependence.family]
    changes = dict.fromkeys(NAMES, 0.0)
    for freed, coefficient in zip(gain.freed, gain.coefficients, strict=True):
        changes |= {name: float(coefficient) for name, _ in freed}
    source = dependence.source or 0
    known = dict(zip(dependence.freed, dependence.coefficients, strict=True))
    values: dict[Freed, float] = {}
    for direction, name in zip(range(N_DIRECTION), NAMES, strict=True):
        for basis in range(card.n_basis):
            of: Freed = (("coefficients", (direction, source, basis)),)
            change = known.get(of, 0.0)
            values[of] = (1.0 + change) * (1.0 + changes[name]) - 1.0
    return replace(dependence, freed=tuple(values), coefficients=np.array(list(values.values())))
