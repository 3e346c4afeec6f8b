"""The posterior over explanations: sets of causes, each a family on one joint or on several.

Before any row is seen a set of n causes has probability 2^{-n-1}; every family is as probable as any other, and so are
its joints, sources, grid points and moments. The best sets are found by adding causes one at a time to all of the best
sets so far (beam search), with normal noise. These are scored again with heavy-tailed noise.

What the card of one effect lacks can feign a second effect on the same joint. `CARD_ERROR` is the share of the first
one's evidence that it may be worth.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from pipeline.discrepancy.families.plausibility import DELAY, LOAD, TIMING
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.posterior.gram import Prior
from pipeline.discrepancy.posterior.joint_evidence import JointEvidence
from pipeline.discrepancy.posterior.robust_evidence import Block, fit
from pipeline.discrepancy.posterior.speed_in_time import DEVIATIONS, N_COSINE, TIMES_S, deviations
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
    """A set of causes, empty where nothing has changed, and its probability."""

    causes: tuple[Cause, ...]
    probability: float


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
        self._on_several = [f for f in families if KNOWN[f].card.scope is Scope.machine or f == LOAD]
        self._setting_in = [
            f for f in families if KNOWN[f].card.can_set_in and (f == LOAD or f not in self._on_several)
        ]
        # Slow variations of speed, which have no equation.
        self._slow = [f for f in (SUPPLY, COURSE) if f not in excluded and (f == COURSE or len(joints) > 1)]
        # Besides the catalogue: a change point, and those without an equation.
        self._log_family = float(-np.log(len(self.families) + len(self._slow) + 1))

    def explanations(self) -> list[Explanation]:
        """Every set that was scored again, most probable first."""
        for joint in self.joints:
            joint.let_set_in(self._setting_in)
        scored = self._search()
        again = [(self._score(causes), causes) for causes in scored]
        again += self._of_slow_variations()
        total = logsumexp([score for score, _ in again])
        result = [Explanation(causes, float(np.exp(score - total))) for score, causes in again]
        return sorted(result, key=lambda of: -of.probability)

    def _search(self) -> list[tuple[Cause, ...]]:
        """Sets that are worth a second look: the best, the best single causes, and none."""
        known: dict[frozenset, tuple[float, tuple[Cause, ...]]] = {frozenset(): (0.0, ())}
        frontier = [known[frozenset()]]
        for _ in range(MOST_CAUSES):
            longer: dict[frozenset, tuple[float, tuple[Cause, ...]]] = {}
            for score, causes in frontier:
                for evidence, cause in self._causes(_terms_of(causes)):
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
                if family in self._on_several and not sets_in:
                    continue
                prior = self._log_family - np.log(n)
                if source is not None:  # no joint's speed depends on its own command by another name
                    prior -= np.log(n - 1 if family == COMMAND else n)
                prior -= np.log(len(self._setting_in)) if sets_in else 0.0
                yield found.evidence, Cause(family, source, {number: found.best}, (number,), sets_in, prior)
        for family in self._on_several:
            if (cause := self._on_some_joints(family, beside)) is not None:
                yield cause

    def _on_some_joints(
        self, family: str, beside: Mapping[int, tuple[int, ...]]
    ) -> tuple[float, Cause] | None:
        """A cause with common values of nonlinear parameters, on every joint that it helps; a late channel on all."""
        by_point: dict[tuple, dict[int, tuple[float, int]]] = defaultdict(dict)
        for number, joint in enumerate(self.joints):
            _, evidence = joint.groups(beside.get(number, ()))
            of_point: dict[tuple, list[int]] = defaultdict(list)
            for index, (term, onset) in enumerate(zip(joint.terms, joint.onsets, strict=True)):
                if term.family == family and onset is None:
                    of_point[tuple(sorted(term.point.items()))].append(index)
            for point, indices in of_point.items():
                value = float(logsumexp(evidence[indices]) - np.log(len(indices)))
                by_point[point][number] = value, indices[int(np.argmax(evidence[indices]))]
        everywhere = family == TIMING
        helped = [
            {j: of for j, of in joints.items() if everywhere or of[0] > 0.0} for joints in by_point.values()
        ]
        totals = [sum(value for value, _ in joints.values()) for joints in helped]
        if not any(helped):
            return None
        best = helped[int(np.argmax(totals))]
        terms = {joint: index for joint, (_, index) in best.items()}
        free = 0 if everywhere else len(self.joints)
        prior = float(self._log_family - free * np.log(2.0))  # each joint has part in it or not
        marginal = float(logsumexp(totals) - np.log(len(totals)))
        return marginal, Cause(family, None, terms, tuple(sorted(terms)), False, prior)

    def _score(self, causes: tuple[Cause, ...]) -> float:
        """Log probability, but for a constant, with heavy-tailed noise."""
        terms = _terms_of(causes)
        score = sum(cause.log_prior + LOG_MORE for cause in causes)
        for number, joint in enumerate(self.joints):
            of_joint = terms.get(number, ())
            evidence = joint.fit(of_joint).evidence
            score += evidence
            if len(of_joint) > 1:
                first = max(joint.fit((term,)).evidence for term in of_joint) - joint.fit(()).evidence
                score -= CARD_ERROR * max(first, 0.0) * (len(of_joint) - 1)
        for cause in causes:  # a grid point is chosen once, not on each joint
            members = [(self.joints[j], index) for j, index in cause.terms.items()]
            score -= sum(np.log(joint.n_alternatives(index)) for joint, index in members)
            score += (len(members) - 1) * np.log(members[0][0].n_points(members[0][1]))
        return float(score)

    def _of_slow_variations(self) -> list[tuple[float, tuple[Cause, ...]]]:
        """Speed that varies in time without a cause that is measured: in common, or of one joint."""
        processes = [(time_s, deviation) for time_s in TIMES_S for deviation in DEVIATIONS]
        nothing = [joint.fit(()).evidence for joint in self.joints]
        found = []
        if SUPPLY in self._slow:
            everywhere = tuple(range(len(self.joints)))
            of_all = Cause(SUPPLY, None, {}, everywhere, False, self._log_family)
            blocks = self._of_all_joints()
            together = [self._in_common(blocks, *process) for process in processes]
            found.append((together, 0.0, of_all))
        for number, joint in enumerate(self.joints if COURSE in self._slow else []):
            alone = [joint.fit((), speed=process).evidence for process in processes]
            prior = self._log_family - np.log(len(self.joints))
            of_one = Cause(COURSE, None, {}, (number,), False, prior)
            found.append((alone, sum(nothing) - nothing[number], of_one))
        return [
            (float(logsumexp(of) - np.log(len(of))) + others + cause.log_prior + LOG_MORE, (cause,))
            for of, others, cause in found
        ]

    def _of_all_joints(self) -> list[Block]:
        """Every joint's sessions, with slow variations of speed as effects that joints have in common."""
        blocks = []
        for joint in self.joints:
            of_session = joint.speed_columns()
            for number, (block, speed) in enumerate(
                zip(joint.blocks((), joint.least()), of_session, strict=True)
            ):
                effects = np.zeros((len(speed), len(of_session) * N_COSINE))
                effects[:, number * N_COSINE : (number + 1) * N_COSINE] = speed
                blocks.append(block._replace(effects=effects))
        return blocks

    def _in_common(self, blocks: Sequence[Block], time_s: float, deviation: float) -> float:
        """Log evidence of a common variation of speed of all joints."""
        n = blocks[0].effects.shape[1]
        precision = deviations(self.joints[0].length_s, time_s, deviation) ** -2
        free = np.full(n, np.inf)
        of_sessions = np.tile(precision, n // N_COSINE)
        return fit(blocks, Prior(np.zeros(0, int), np.zeros(n), of_sessions, -free, free)).evidence


def _terms_of(causes: Sequence[Cause]) -> dict[int, tuple[int, ...]]:
    """By joint the terms of all causes."""
    terms: dict[int, tuple[int, ...]] = defaultdict(tuple)
    for cause in causes:
        for joint, index in cause.terms.items():
            terms[joint] += (index,)
    return terms


def _is_same(one: Cause, other: Cause) -> bool:
    """Whether a joint would have the same twice: a late channel is a delay of its joints."""
    is_alike = (one.family, one.source) == (other.family, other.source)
    is_alike |= {one.family, other.family} == {DELAY, TIMING}
    return is_alike and bool(set(one.joints) & set(other.joints))
