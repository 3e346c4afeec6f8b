"""From explanations to what is told: causes that belong together, how probable each is, and its rivals."""

from collections.abc import Sequence
from typing import NamedTuple

from pipeline.discrepancy.posterior.explanations import Cause, Explanation
from pipeline.discrepancy.selection.grouping import told_as
from pipeline.effects.dependence import DEPENDENCES


class Finding(NamedTuple):
    """One effect as it is told.

    Attributes:
        family: As in the contract.
        causes: That it is made of: a dependence, then what else acts on its joints.
    """

    family: str
    causes: tuple[Cause, ...]

    @property
    def joints(self) -> frozenset[int]:
        """Indices."""
        return frozenset(joint for cause in self.causes for joint in cause.joints)

    @property
    def label(self) -> tuple:
        """What tells it from others: family, joints, and whether it sets in."""
        return self.family, self.joints, all(cause.sets_in for cause in self.causes)

    def has_part_in(self, explanation: Explanation) -> bool:
        """Whether an explanation has an effect of the same name, on one of its joints at least."""
        return any(self.is_like(other) for other in findings_of(explanation.causes))

    def is_like(self, other: "Finding") -> bool:
        """Whether both would be told by the same name, for one joint at least."""
        same = (self.family, self.label[2]) == (other.family, other.label[2])
        return same and bool(self.joints & other.joints)


def findings_of(causes: Sequence[Cause]) -> list[Finding]:
    """The effects of an explanation.

    The form of a dependence is a guess. What it leaves over on its joint, another cause may seem to explain: beside a
    dependence no name is told there.
    """
    unknown = [cause for cause in causes if cause.family in DEPENDENCES]
    groups: list[list[Cause]] = [[cause] for cause in unknown]
    for cause in causes:
        if cause in unknown:
            continue
        group = next((of for of in groups[: len(unknown)] if set(cause.joints) <= set(of[0].joints)), None)
        if group is None:
            groups.append([cause])
        else:
            group.append(cause)
    return [Finding(told_as(of[0].family), tuple(of)) for of in groups]


def probability_of(finding: Finding, explanations: Sequence[Explanation]) -> float:
    """Of all explanations that have it."""
    total = sum(of.probability for of in explanations if finding.has_part_in(of))
    return float(min(total, 1.0))  # rounding adds up


def probability_of_none(explanations: Sequence[Explanation]) -> float:
    """That nothing has changed."""
    return float(sum(of.probability for of in explanations if not of.causes))


def rivals_of(
    finding: Finding, explanations: Sequence[Explanation], credible: float
) -> list[tuple[Finding, Explanation, float]]:
    """What may stand in its place, with an explanation that has it, until the credible set is full.

    Args:
        finding: In question.
        explanations: Most probable first.
        credible: Probability that the finding and its rivals hold together.
    """
    held = probability_of(finding, explanations)
    of_rivals: dict[tuple, tuple[Finding, Explanation, float]] = {}
    for explanation in explanations:
        if finding.has_part_in(explanation):
            continue
        for rival in findings_of(explanation.causes):
            if not rival.joints & finding.joints:
                continue
            first, best, before = of_rivals.get(rival.label, (rival, explanation, 0.0))
            of_rivals[rival.label] = first, best, before + explanation.probability
    result = []
    for of in sorted(of_rivals.values(), key=lambda of: -of[2]):
        if held >= credible:
            break
        held += of[2]
        result.append(of)
    return result
