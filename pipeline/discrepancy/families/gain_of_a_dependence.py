"""A gain beside a dependence on the same joint that it is but the mean of: both are the dependence.

A joint that is slower wherever another one stands beyond some place is slower in most of the logs, which a gain
explains first. What is left then depends on the place: elsewhere the joint is faster than that gain. It has none. So it
is with a course in time that had explained as much as the gain, of which it then leaves a good part. And where a course
was sought beside a gain, or a change that all joints have in common, but is not borne out, the gain is not certain: a
joint that is only slower leaves nothing like it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.families.plausibility import GAIN
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.dependence import DEPENDENCES, N_DIRECTION
from pipeline.effects.effect import Freed

NAMES = ("ratio_negative", "ratio_positive")  # in the order of a dependence's directions


def with_its_gain(found: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """The effects, a gain taken into the dependence on its joint that counts from a reference, or is as good."""
    result = list(found)
    for gain in found:
        if gain.candidate.family != GAIN or gain.candidate.onset is not None or gain.known is not None:
            continue
        for place, beside in enumerate(result):
            if beside.known is not None:
                continue
            whole = _instead_of_both(beside.candidate, gain)
            if whole is not None:
                told = [*beside.losers, (gain.candidate, "is the mean of what varies")]
                result[place] = replace(beside, candidate=whole, losers=told)
                result.remove(gain)
                break
    return result


def doubted_by_what_varies(
    passed: Sequence[SelectedEffect], found: Sequence[SelectedEffect], screened: Sequence[Candidate]
) -> list[SelectedEffect]:
    """Effects that passed the gate; a gain beside a variation that did not has the joint's course as its equivalent.

    Args:
        passed: Of `found`.
        found: All that the search took.
        screened: Candidates of the first screen, without anything beside them.
    """
    known = {f.candidate.key for f in passed}
    # A common change that is borne out elsewhere is known; that a joint has no part in it says nothing of its gain.
    doubtful = (COURSE,) if any(f.candidate.family == SUPPLY for f in passed) else (COURSE, SUPPLY)
    varying = {
        f.candidate.joint: f.candidate
        for f in found
        if f.candidate.family in doubtful and f.candidate.key not in known
    }
    result = []
    for effect in passed:
        joint = effect.candidate.joint
        if effect.candidate.family == GAIN and joint in varying:
            course = next((c for c in screened if c.family == COURSE and c.joint == joint), varying[joint])
            if all(c.family != course.family for c in effect.equivalents):
                effect = replace(effect, equivalents=[*effect.equivalents, course])
        result.append(effect)
    return result


def _instead_of_both(candidate: Candidate, gain: SelectedEffect) -> Candidate | None:
    if candidate.joint != gain.candidate.joint:
        return None
    if candidate.family == COURSE:  # nothing takes it off what is left: it is as it was without the gain
        return next((c for c in gain.equivalents if c.family == COURSE), None)
    card = DEPENDENCES.get(candidate.family)
    if card is None or card.reference is None:
        return None
    return _together(candidate, gain.candidate)


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
