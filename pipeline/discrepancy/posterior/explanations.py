"""The posterior over explanations: sets of causes, each a family on one joint or on several.

Before any row is seen a set of n causes has probability 2^{-n-1}; every family is as probable as any other, and so are
its joints, sources, grid points and moments. The best sets are found by adding causes one at a time to all of the best
sets so far (beam search), with normal noise. These are scored again with heavy-tailed noise.

What the card of one effect lacks is part of the nuisance, in the form of all families together. In the form of one of
them it feigns a second effect on the same joint. So that one has to be worth more than `CARD_ERROR` of the first one's
evidence.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from pipeline.discrepancy.families.plausibility import DELAY, LOAD, TIMING
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.posterior.evidence.joint_evidence import Found, JointEvidence
from pipeline.discrepancy.posterior.evidence.slow_variations import evidence_of_processes
from pipeline.discrepancy.posterior.probabilities import log_probabilities
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import OnCommand
from pipeline.effects.effect import Scope

COMMAND = OnCommand.card.family
LOG_MORE = np.log(0.5)  # one more cause
MOST_CAUSES = 3
BEAM = 12
RESCORED, RESCORED_SINGLE = 12, 8
CARD_ERROR = 0.1


class Cause(NamedTuple):
    """One cause.

    Attributes:
        family: Name.
        source: Joint that it depends on; None where the family has none.
        terms: By joint the index of the term; empty for slow variations of speed.
        joints: On which it acts.
        sets_in: Whether it does so within the logs.
        log_prior: Of family, joints and source, not of grid points.
    """

    family: str
    source: int | None
    terms: Mapping[int, int]
    joints: tuple[int, ...]
    sets_in: bool
    log_prior: float

    @property
    def label(self) -> tuple:
        """What tells it from others."""
        return self.family, self.source, self.joints, self.sets_in


class Explanation(NamedTuple):
    """A set of causes, empty where nothing has changed.

    Attributes:
        causes: Strongest first.
        probability: Beside the other explanations.
        log_prior: Before any row is seen, grid points included; but for a constant.
        log_evidence: Of the rows, over that of no cause.
    """

    causes: tuple[Cause, ...]
    probability: float
    log_prior: float
    log_evidence: float


class Posterior:
    """Over explanations of one set of measured logs."""

    def __init__(
        self, joints: Sequence[JointEvidence], families: Sequence[str], excluded: Collection[str] = ()
    ) -> None:
        """Prepare.

        Args:
            joints: All of the machine.
            families: With an equation, that are tried.
            excluded: Of those without one, which are not.
        """
        self.joints = joints
        self.families = list(families)
        self._on_several = [family for family in families if acts_on_several(family)]
        self._setting_in = [family for family in families if KNOWN[family].card.can_set_in]
        # Slow variations of speed, which have no equation.
        self._slow = [f for f in (SUPPLY, COURSE) if f not in excluded and (f == COURSE or len(joints) > 1)]
        # Besides the catalogue: a change point, and those without an equation.
        self._log_family = float(-np.log(len(self.families) + len(self._slow) + 1))

    def explanations(self) -> list[Explanation]:
        """Every set that was scored again, most probable first."""
        self._let_set_in()
        nothing = sum(joint.fit(()).evidence for joint in self.joints)
        scored = [Explanation(causes, 0.0, *self._score(causes, nothing)) for causes in self._search()]
        scored += self._of_slow_variations()
        return with_probabilities(scored)

    def _let_set_in(self) -> None:
        """Of each family let the most probable term of a joint set in, and the one that joints would share."""
        for joint in self.joints:
            groups, _ = joint.groups(())
            keys = [(family, None, False) for family in self._setting_in]
            joint.let_set_in([groups[key].best for key in keys if key in groups], joint.moments())
        # A grid point is known no better than the moment: first the moment with any point, then the point.
        of_several = [family for family in self._setting_in if family in self._on_several]
        moments = {family: self._common_moment(family) for family in of_several}
        for joint in self.joints:
            for family, moment in moments.items():
                if moment is not None:
                    joint.let_set_in(joint.without_onset(family), [moment])
        shared = [self._on_some_joints(family, {}, sets_in=True) for family in of_several]
        for _, cause in filter(None, shared):
            for number, index in cause.terms.items():
                joint = self.joints[number]
                joint.let_set_in([joint.base(index)], joint.moments())

    def _common_moment(self, family: str) -> int | None:
        """The most probable one, if each joint may have a point of its own."""
        evidence: dict[int, float] = defaultdict(float)
        for joint in self.joints:
            _, of_terms = joint.groups(())
            for term, onset, of in zip(joint.terms, joint.onsets, of_terms, strict=True):
                if term.family == family and onset is not None:
                    evidence[onset] += max(float(of), 0.0)
        return max(evidence, key=lambda moment: evidence[moment]) if evidence else None

    def _search(self) -> list[tuple[Cause, ...]]:
        """Sets that are worth a second look: the best, the best single causes, and none."""
        known: dict[frozenset, tuple[float, tuple[Cause, ...]]] = {frozenset(): (0.0, ())}
        frontier = [known[frozenset()]]
        for _ in range(MOST_CAUSES):
            longer: dict[frozenset, tuple[float, tuple[Cause, ...]]] = {}
            for score, causes in frontier:
                for evidence, cause in self._causes(terms_of(causes)):
                    if any(_is_same(cause, other) for other in causes):
                        continue
                    key = frozenset(of.label for of in (*causes, cause))
                    value = score + evidence + cause.log_prior + LOG_MORE
                    if key not in longer or value > longer[key][0]:
                        longer[key] = value, (*causes, cause)
            known.update({key: of for key, of in longer.items() if key not in known})
            frontier = sorted(longer.values(), key=lambda of: -of[0])[:BEAM]
        ranked = sorted(known.values(), key=lambda of: -of[0])
        single = [of for of in ranked[RESCORED:] if len(of[1]) == 1][:RESCORED_SINGLE]
        sets = [causes for _, causes in ranked[:RESCORED] + single]
        return sets if () in sets else [*sets, ()]

    def _causes(self, beside: Mapping[int, tuple[int, ...]]) -> Iterator[tuple[float, Cause]]:
        """Every cause with its evidence beside given terms."""
        n = len(self.joints)
        for number, joint in enumerate(self.joints):
            groups, _ = joint.groups(beside.get(number, ()))
            for (family, source, sets_in), found in groups.items():
                if family in self._on_several:
                    continue
                prior = self._log_family - np.log(n)
                if source is not None:  # no joint's speed depends on its own command by another name
                    prior -= np.log(n - 1 if family == COMMAND else n)
                prior -= np.log(len(self._setting_in)) if sets_in else 0.0
                yield found.evidence, Cause(family, source, {number: found.best}, (number,), sets_in, prior)
        for family in self._on_several:
            for sets_in in (False, True):
                if (cause := self._on_some_joints(family, beside, sets_in)) is not None:
                    yield cause

    def _on_some_joints(
        self, family: str, beside: Mapping[int, tuple[int, ...]], sets_in: bool
    ) -> tuple[float, Cause] | None:
        """A cause with common values of nonlinear parameters, and a common moment, on every joint that it helps.

        A late channel is on all joints.
        """
        by_point: dict[tuple, dict[int, Found]] = defaultdict(dict)
        for number, joint in enumerate(self.joints):
            for point, found in joint.points(family, sets_in, beside.get(number, ())).items():
                by_point[point][number] = found
        everywhere = family == TIMING
        helped = [
            {j: of for j, of in joints.items() if everywhere or of.evidence > 0.0}
            for joints in by_point.values()
        ]
        totals = [sum(of.evidence for of in joints.values()) for joints in helped]
        if not any(helped):
            return None
        best = helped[int(np.argmax(totals))]
        terms = {joint: of.best for joint, of in best.items()}
        free = 0 if everywhere else len(self.joints)
        prior = self._log_family - free * np.log(2.0)  # each joint has part in it or not
        prior -= np.log(len(self._setting_in)) if sets_in else 0.0
        marginal = float(logsumexp(totals) - np.log(len(totals)))
        return marginal, Cause(family, None, terms, tuple(sorted(terms)), sets_in, float(prior))

    def _score(self, causes: tuple[Cause, ...], nothing: float) -> tuple[float, float]:
        """Log prior and log evidence, with heavy-tailed noise."""
        terms, evidence = terms_of(causes), -nothing
        for number, joint in enumerate(self.joints):
            of_joint = terms.get(number, ())
            evidence += joint.fit(of_joint).evidence
            if len(of_joint) > 1:
                first = max(joint.fit((term,)).evidence for term in of_joint) - joint.fit(()).evidence
                evidence -= CARD_ERROR * max(first, 0.0) * (len(of_joint) - 1)
        prior = sum(cause.log_prior + LOG_MORE for cause in causes)
        for cause in causes:  # a grid point and a moment are chosen once, not on each joint
            members = [(self.joints[j], index) for j, index in cause.terms.items()]
            prior -= sum(np.log(joint.n_alternatives(index)) for joint, index in members)
            prior += (len(members) - 1) * np.log(members[0][0].n_choices(members[0][1]))
        return float(prior), float(evidence)

    def _of_slow_variations(self) -> list[Explanation]:
        """Speed that varies in time without a cause that is measured: in common, or of one joint."""
        n = len(self.joints)
        causes = [Cause(SUPPLY, None, {}, tuple(range(n)), False, self._log_family)]
        causes += [
            Cause(COURSE, None, {}, (j,), False, float(self._log_family - np.log(n))) for j in range(n)
        ]
        found = []
        for cause in causes:
            if cause.family in self._slow:
                of = evidence_of_processes(self.joints, cause.joints)
                without = sum(self.joints[joint].fit(()).evidence for joint in cause.joints)
                evidence = float(logsumexp(of) - np.log(len(of))) - without
                found.append(Explanation((cause,), 0.0, cause.log_prior + LOG_MORE, evidence))
        return found


def with_probabilities(explanations: Sequence[Explanation]) -> list[Explanation]:
    """By their priors and evidence, most probable first."""
    prior, evidence = np.array([(of.log_prior, of.log_evidence) for of in explanations]).T
    is_none = np.array([not of.causes for of in explanations])
    probability = np.exp(log_probabilities(prior, evidence, is_none))
    result = [of._replace(probability=float(p)) for of, p in zip(explanations, probability, strict=True)]
    return sorted(result, key=lambda of: -of.probability)


def acts_on_several(family: str) -> bool:
    """Whether one cause of the family may act on several joints."""
    return KNOWN[family].card.scope is Scope.machine or family == LOAD


def terms_of(causes: Sequence[Cause]) -> dict[int, tuple[int, ...]]:
    """By joint the terms of all causes."""
    terms: dict[int, tuple[int, ...]] = defaultdict(tuple)
    for cause in causes:
        for joint, index in cause.terms.items():
            terms[joint] += (index,)
    return terms


def _is_same(one: Cause, other: Cause) -> bool:
    """Whether a joint would have the same twice."""
    is_alike = are_alike((one.family, one.source), (other.family, other.source))
    return is_alike and bool(set(one.joints) & set(other.joints))


def are_alike(one: tuple[str, int | None], other: tuple[str, int | None]) -> bool:
    """Whether families with their sources are the same on a joint: a late channel is a delay of its joints."""
    return one == other or {one[0], other[0]} == {DELAY, TIMING}
