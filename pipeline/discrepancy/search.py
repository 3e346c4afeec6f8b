"""Forward selection of effects: screen, take the simplest of the best, refine, look again, and at last look back.

A candidate's gain is compared with what the same candidate gains on the nominal logs, where there is nothing to find
but the diagnosis model's own misfit. Among those that are not significantly worse than the best, the simplest is
taken; what is as simple and as good is kept as its equivalent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.common_speed import common_speed_candidates
from pipeline.discrepancy.found import Found, onsets_of, residual_of, values_of
from pipeline.discrepancy.onset import with_onsets
from pipeline.discrepancy.refine import gain_without, refine, refine_alone
from pipeline.discrepancy.regression import evidence
from pipeline.discrepancy.screen import Candidate, Rows, scored, screen
from pipeline.discrepancy.simulation import Simulation
from pipeline.discrepancy.stops import Encoder
from pipeline.errors import InputError

Null = Mapping[tuple[str, int, int | None], float]


@dataclass
class SearchConfig:
    """Thresholds of the search.

    Attributes:
        smallest_share: Of the squared residual; an effect that removes less is not looked for.
        smallest_gain: The same in units of the noise floor's squares.
        second_share: A further effect on a joint has to gain this share of what the first gained there.
        null_factor: How many times its gain on nominal logs a candidate has to exceed.
        smallest_t: Of the gain over its standard error by blocks.
        second_t: The same of further effects, which may be what the first leaves over.
        equivalent_t: A candidate is worse than the best only if the difference is so many standard errors.
        maximum_effects: The search ends when it has found so many.
        block_s: Length of a block of the bootstrap, longer than the residual's correlation.
        nominal_rows: Of nominal logs, at most, on which the same search is run for comparison.
    """

    smallest_share: float
    smallest_gain: float
    second_share: float
    null_factor: float
    smallest_t: float
    second_t: float
    equivalent_t: float
    maximum_effects: int
    block_s: float
    nominal_rows: int

    def __post_init__(self) -> None:
        if not 0 < self.smallest_share < 1:
            raise InputError(
                f"close_loop.search.smallest_share is {self.smallest_share}; it must be in (0, 1)"
            )
        if self.maximum_effects < 1:
            raise InputError("close_loop.search.maximum_effects must be at least 1")


# From the simplest to the most general; a named family that says as much is preferred to one that says less.
COMPLEXITY = {
    "gain": 1.0,
    "delay": 1.0,
    "leakage": 1.0,
    "backlash": 1.2,
    "lag": 1.0,
    "sensor_bias": 1.3,
    "stiction": 1.5,
    "end_cushion": 2.0,
    "flow_coupling": 2.5,
    "oscillation": 2.5,
    "thermal_drift": 2.5,
    "load": 3.0,
    SUPPLY: 4.0,
}
OTHER_COMPLEXITY = 5.0


def complexity(candidate: Candidate) -> float:
    """How much a candidate can fit; an onset is one choice more."""
    two_ways = 2.8 * (candidate.family == "gain" and len(candidate.freed) > 1)
    return COMPLEXITY.get(candidate.family, OTHER_COMPLEXITY) + two_ways + 0.6 * (candidate.onset is not None)


def null_gains(
    simulation: Simulation, rows: Rows, excluded: Sequence[str]
) -> dict[tuple[str, int, int | None], float]:
    """Gain per used row that each candidate has on nominal logs."""
    candidates = screen(simulation, {}, rows, excluded) + common_speed_candidates(simulation, {}, rows)
    n = len(rows.folds.fold)
    return {(c.family, c.joint, c.source): max(0.0, c.gain) / n for c in candidates}


class Search:
    """The state of a forward selection on one set of measured logs."""

    def __init__(
        self,
        simulation: Simulation,
        rows: Rows,
        null: Null,
        config: SearchConfig,
        excluded: Sequence[str] = (),
        encoders: Mapping[int, Encoder] = MappingProxyType({}),
        say: Callable[[str], None] | None = None,
    ) -> None:
        self.simulation, self.rows, self.null, self.config = simulation, rows, null, config
        self.excluded = tuple(excluded)
        self.encoders = encoders
        self.found: list[Found] = []
        self._closed: set[int] = set()  # joints on which nothing plausible is left
        self.first: list[Candidate] = []  # of the first screen, for the ranking
        self._say = say or (lambda _: None)

    def net(self, candidate: Candidate) -> float:
        """Gain beyond what the candidate gains on nominal logs."""
        null = self.null.get((candidate.family, candidate.joint, candidate.source), 0.0)
        return candidate.gain - self.config.null_factor * null * len(self.rows.folds.fold)

    def passes(self, candidate: Candidate) -> bool:
        """Whether it removes enough, beyond chance and beyond the model's own misfit."""
        squares = candidate.gain / candidate.share if candidate.share > 0 else np.inf
        smallest_t = self.config.second_t if self.found else self.config.smallest_t
        if candidate.family in COMMON_CAUSES and not self.found:
            smallest_t = COMMON_T
        return (
            candidate.share > self.config.smallest_share
            and self.net(candidate)
            > max(self.config.smallest_share * squares, self.config.smallest_gain * len(self.rows.folds.fold))
            and _t(candidate.gain_by_block) > smallest_t
        )

    def run(self) -> list[Found]:
        """Find effects until none is left that passes."""
        self._compare_stops()
        for _ in range(self.config.maximum_effects):
            candidates = self._candidates()
            passing = [candidate for candidate in candidates if self.passes(candidate)]
            if any(f.candidate.family in COMMON_CAUSES for f in self.found):
                passing = [c for c in passing if c.family not in COMMON_CAUSES]
            passing = self._without_repairs([c for c in passing if self._may_stand_alone(c, candidates)])
            passing = [c for c in passing if c.joint not in self._closed]
            if not passing:
                break
            self.found += self._choose(passing, candidates)
            self._refit()
            self.simulation.onsets = onsets_of(self.found)
        self._look_back()
        return self.found

    def _may_stand_alone(self, candidate: Candidate, candidates: Sequence[Candidate]) -> bool:
        """Whether it is plausible on its joint, and oil that warms up shows on another joint, too."""
        if candidate.family == THERMAL_DRIFT:
            showing = [c for c in candidates if c.family == THERMAL_DRIFT and self._shows(c)]
            return len(showing) > 1 and _is_plausible(candidate.family, [candidate])
        return candidate.family != FLOW_COUPLING or _is_plausible(candidate.family, [candidate])

    def _compare_stops(self) -> None:
        """An encoder's error is known where stops have moved, before anything else is looked for."""
        if SENSOR_BIAS in self.excluded:
            return
        for joint, encoder in self.encoders.items():
            if encoder.point is None:
                continue
            candidate = self._at_stops(SENSOR_BIAS, joint, encoder.point, encoder.deviation)
            play = self._at_stops(BACKLASH, joint, {"width": 2.0 * encoder.inward}, 2.0 * encoder.deviation)
            if BACKLASH not in self.excluded and encoder.inward > 0.0 and play.gain > candidate.gain:
                self._say(
                    f"the stops of joint {joint} are read further in, which play explains better than its encoder"
                )
                continue
            if _t(candidate.gain_by_block) < -self.config.smallest_t:
                self._say(f"the stops of joint {joint} have moved, but its speeds speak against its encoder")
                continue
            self._say(
                f"the stops of joint {joint} have moved by {encoder.z:.0f} standard deviations: its encoder"
            )
            self.found.append(Found(candidate))

    def _at_stops(self, family: str, joint: int, point: Mapping[str, float], deviation: float) -> Candidate:
        """An effect whose parameters the stops gave, and what it does to the speeds."""
        nothing = np.zeros(0)
        blank = Candidate(family, joint, None, point, (), nothing, 0.0, 0.0, nothing, deviation=deviation)
        before = residual_of(self.simulation, self.rows, [])[:, joint]
        after = residual_of(self.simulation, self.rows, [Found(blank)])[:, joint]
        seen = evidence(before, after, np.zeros((len(before), 0)), self.rows.folds, nothing, nothing)
        candidate = scored(seen, before, self.rows.floor[joint], family, joint, None, point, ())
        return replace(candidate, deviation=deviation)

    def _candidates(self) -> list[Candidate]:
        active = values_of(self.simulation, self.found)
        candidates = screen(self.simulation, active, self.rows, self.excluded)
        if SUPPLY not in self.excluded and not any(f.candidate.family == SUPPLY for f in self.found):
            candidates += common_speed_candidates(self.simulation, active, self.rows)
        taken = {(f.candidate.family, f.candidate.joint, f.candidate.source) for f in self.found}
        candidates = [
            c
            for c in candidates
            if (c.family, c.joint, c.source) not in taken and not self._is_refuted_by_stops(c)
        ]
        candidates = with_onsets(self.simulation, active, self.rows, candidates)
        if not self.first:
            self.first = sorted(candidates, key=self.net, reverse=True)
        return candidates

    def _is_refuted_by_stops(self, candidate: Candidate) -> bool:
        encoder = self.encoders.get(candidate.joint)
        return candidate.family == SENSOR_BIAS and encoder is not None and not encoder.allows(candidate.point)

    def _without_repairs(self, passing: list[Candidate]) -> list[Candidate]:
        """Candidates that are not just a repair of an effect that was found on their joint before.

        Where something is left beside a named effect, and a dependence that no family describes had explained more than
        that name in the first place, the dependence takes its place.
        """
        kept = []
        whole = max(
            (f.candidate.gain for f in self.found if f.candidate.family in WHOLE_MACHINE), default=0.0
        )
        for candidate in passing:
            if candidate.gain < WHOLE_SECOND_SHARE * whole:
                continue  # no wrapper of the whole machine fits every joint so well that nothing is left
            place = next((i for i, f in enumerate(self.found) if f.candidate.joint == candidate.joint), None)
            if place is None or self.found[place].candidate.family in COMMON_CAUSES:
                kept.append(candidate)
                continue
            first = self.found[place].candidate
            if candidate.gain > self.config.second_share * first.gain:
                kept.append(candidate)
                continue
            rivals = [
                c
                for c in self.first
                if c.joint == first.joint and c.family.startswith("other") and self.passes(c)
            ]
            better = max(rivals, key=self.net, default=None)
            if (
                better is not None
                and not first.family.startswith("other")
                and self.net(better) > (1.0 + NEGLIGIBLE) * self.net(first)
            ):
                self._say(f"{better.family} explains more than {first.family} and what is left beside it")
                self.found[place] = Found(better, [], [(first, "leaves structure behind that this does not")])
                self._refit()
        return kept

    def _choose(self, passing: list[Candidate], candidates: list[Candidate]) -> list[Found]:
        """The joint with most to gain; the simplest of its candidates that are not significantly worse."""
        best = max(passing, key=self.net)
        common = self._common(best, passing, candidates)
        if common is not None:
            self._say(
                f"{common[0].candidate.family} on {len(common)} joints explains more together than anything on one"
            )
            return common
        rivals = sorted((c for c in passing if c.joint == best.joint), key=self.net, reverse=True)
        rivals = self._refined(rivals[:REFINED]) + rivals[REFINED:]
        rivals = [c for c in rivals if not self._is_at_bound(c)]
        if not rivals:
            self._say(f"joint {best.joint}: what explains most is {best.family} beyond any plausible value")
            self._closed.add(best.joint)
            return []
        best = max(rivals, key=self.net)
        as_good = [c for c in rivals if not self._is_worse(c, best)]
        chosen = min(as_good, key=lambda c: (complexity(c), -self.net(c)))
        equivalents = [
            c
            for c in as_good
            if c.family != chosen.family
            and complexity(c) < complexity(chosen) + AS_SIMPLE
            and not _same(c, chosen)
        ]
        better = self._better_dependence(chosen, as_good)
        if better is not None:  # a wrong name is worse than none
            chosen, equivalents = better, [chosen, *equivalents]
        self._say(
            f"{chosen.family} on joint {chosen.joint}: removes {chosen.share:.0%} of the squared residual there"
            + (f"; as good: {', '.join(c.family for c in equivalents)}" if equivalents else "")
        )
        losers = []
        for rival in sorted(rivals, key=self.net, reverse=True):
            if rival is not chosen and rival not in equivalents:
                losers.append((rival, _why(rival, chosen, best)))
        found = [Found(chosen, equivalents, losers[:6])]
        if chosen.family in WHOLE_MACHINE:
            # An effect of the whole machine is taken on every joint on which it shows.
            found += [
                Found(c)
                for c in candidates
                if c.family == chosen.family
                and c.joint != chosen.joint
                and c.source == chosen.source
                and self._shows(c)
            ]
        return found

    def _better_dependence(self, chosen: Candidate, as_good: Sequence[Candidate]) -> Candidate | None:
        """The dependence, if any, that explains clearly more than the name chosen."""
        if chosen.family.startswith("other"):
            return None
        others = [c for c in as_good if c.family.startswith("other")]
        best = max(others, key=self.net, default=None)
        if best is None or self.net(best) < DOUBT_FACTOR * self.net(chosen):
            return None
        return best if _t(best.gain_by_block - chosen.gain_by_block) > DOUBT_T else None

    def _is_at_bound(self, candidate: Candidate) -> bool:
        """Whether a named effect fits only with a value at the edge of what is plausible: then it is another."""
        if candidate.family.startswith("other") or candidate.family == SUPPLY:
            return False
        by_name = {p.name: p for p in self.simulation.effects[candidate.family].card.parameters}
        values = list(candidate.point.items())
        for freed, coefficient in zip(candidate.freed, candidate.coefficients, strict=True):
            name = freed[0][0]
            values.append((name, by_name[name].neutral + float(coefficient)))
        for name, value in values:
            parameter = by_name[name]
            margin = AT_BOUND * (parameter.upper - parameter.lower)
            if value > parameter.upper - margin or 0.0 != parameter.lower > value - margin:
                return True
        return False

    def _common(
        self, best: Candidate, passing: list[Candidate], candidates: list[Candidate]
    ) -> list[Found] | None:
        """An effect of the whole machine, where it explains more on all joints together than the best does alone."""
        options: list[tuple[float, list[Candidate]]] = []
        if any(f.candidate.family in COMMON_CAUSES for f in self.found):
            return None  # one cause of what all joints have in common; a second would only mend the first
        for family in (*COMMON_CAUSES, *ON_SEVERAL_JOINTS):
            showing = [c for c in candidates if c.family == family and self._shows(c)]
            if len(showing) < 2 or not _is_plausible(family, showing):
                continue
            here = next((c for c in candidates if c.family == family and c.joint == best.joint), None)
            total = sum(self.net(c) for c in showing)
            is_rival = (
                here is None
                or here.gain > RIVAL_SHARE * best.gain
                or here.joint not in {c.joint for c in showing}
            )
            if (
                is_rival
                and total > COMMON_FACTOR * self.net(best)
                and max(map(self.net, showing)) > 0.4 * self.net(best)
            ):
                options.append((total / COMMON_PENALTY.get(family, 1.0), showing))
        if not options:
            return None
        showing = max(options, key=lambda option: option[0])[1]
        if not any(self.passes(c) for c in showing):
            return None
        return [Found(c) for c in sorted(showing, key=self.net, reverse=True)]

    def _refined(self, candidates: list[Candidate]) -> list[Candidate]:
        """Candidates moved off their grids; dependences are linear and stay."""
        return [
            c
            if c.family.startswith("other") or c.family == SUPPLY
            else refine_alone(self.simulation, self.rows, self.found, c)
            for c in candidates
        ]

    def _shows(self, candidate: Candidate) -> bool:
        """Whether an effect that other joints have too can be seen on this one; weaker than `passes`."""
        return (
            self.net(candidate) > 0.0
            and candidate.share > 0.5 * self.config.smallest_share
            and _t(candidate.gain_by_block) > SHOWS_T
        )

    def _is_worse(self, candidate: Candidate, best: Candidate) -> bool:
        difference = best.gain_by_block - candidate.gain_by_block
        allowance = self.null.get((best.family, best.joint, best.source), 0.0) * len(self.rows.folds.fold)
        significant = _t(difference) > self.config.equivalent_t
        return bool(significant and difference.sum() > max(allowance, NEGLIGIBLE * best.gain))

    def _refit(self) -> None:
        self.found = refine(self.simulation, self.rows, self.found)

    def _look_back(self) -> None:
        """Drop what the others made superfluous."""
        kept = list(self.found)
        for found in sorted(kept, key=lambda f: -complexity(f.candidate)):
            if len(kept) == 1 or found.candidate.family == SUPPLY or found.candidate.deviation is not None:
                continue
            by_block = gain_without(self.simulation, self.rows, kept, found)
            squares = found.candidate.gain / max(found.candidate.share, 1e-9)
            if (
                by_block.sum() < 0.4 * self.config.smallest_share * squares
                or _t(by_block) < self.config.smallest_t
            ):
                kept.remove(found)
                self._say(
                    f"{found.candidate.family} on joint {found.candidate.joint} is superfluous beside the others"
                )
        if len(kept) != len(self.found):
            self.found = kept
            self._refit()


SENSOR_BIAS, BACKLASH = "sensor_bias", "backlash"
REFINED = 3  # of a joint's candidates
THERMAL_DRIFT = "thermal_drift"
COMMON_CAUSES = (THERMAL_DRIFT, SUPPLY, "other:activity")
COMMON_FACTOR = 1.3
RIVAL_SHARE = 0.7
FLOW_COUPLING = "flow_coupling"
APART = 0.8  # of the larger change: by so much the two directions differ under a load
SHOWS_T = 1.5
COMMON_T = 2.0  # what all joints have in common may lie in few blocks, and joints bear each other out
ON_SEVERAL_JOINTS = (FLOW_COUPLING, "load")  # one pump, one payload
# A cause with an equation comes before a dependence, and both before one that nobody can observe.
COMMON_PENALTY = {"other:activity": 1.1, SUPPLY: 1.25}
WHOLE_MACHINE = (THERMAL_DRIFT, "timing", SUPPLY, "other:activity", FLOW_COUPLING)
WHOLE_SECOND_SHARE = 0.5
AS_SIMPLE = 0.4
DOUBT_FACTOR, DOUBT_T = 1.1, 1.0
AT_BOUND = 0.01  # of the range between the bounds
NEGLIGIBLE = 0.015  # of the gain: too small a difference to decide between names


def _is_plausible(family: str, showing: Sequence[Candidate]) -> bool:
    """Whether the signs are those of the cause on most joints.

    Oil that warms up makes faster; a joint that is slower both ways carries no load; nothing loses more than all of its
    speed to others.
    """
    if family == THERMAL_DRIFT:
        return sum(c.coefficients[0] > 0.0 for c in showing) > 0.5 * len(showing)
    if family == "load":
        both_ways = [c.coefficients[:2] for c in showing]
        tells_apart = [np.ptp(of_joint) > APART * np.abs(of_joint).max() for of_joint in both_ways]
        return sum(tells_apart) > 0.5 * len(showing)
    if family == FLOW_COUPLING:
        return sum(c.coefficients.sum() < 1.0 for c in showing) > 0.5 * len(showing)
    return True


def _same(one: Candidate, other: Candidate) -> bool:
    """Whether naming both would say nothing.

    `timing` is the delay of all joints: on one joint alone they are the same wrapper. An encoder's offset changes no
    speed, but for the little that speeds depend on the place: it is no other reading of a gain.
    """
    families = {one.family, other.family}
    offset = any(c.family == "sensor_bias" and "offset" in c.point for c in (one, other))
    return families == {"delay", "timing"} or (families == {"gain", "sensor_bias"} and offset)


def _t(by_block: np.ndarray) -> float:
    spread = np.std(by_block, ddof=1) * np.sqrt(len(by_block))
    return float(by_block.sum() / max(spread, 1e-12))


def _why(rival: Candidate, chosen: Candidate, best: Candidate) -> str:
    if complexity(rival) > complexity(chosen) and rival.gain <= 1.02 * best.gain:
        return f"removes {rival.share:.0%} with more freedom, {chosen.family} {chosen.share:.0%} with less"
    return f"removes {rival.share:.0%} of the squared residual, {chosen.family} {chosen.share:.0%}"
