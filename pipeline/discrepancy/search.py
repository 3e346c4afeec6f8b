"""Forward selection of effects: screen, take the simplest of the best, refine, look again, and at last look back.

A candidate's gain is compared with what the same candidate gains on the nominal logs, where there is nothing to find
but the diagnosis model's own misfit. Among those that are not significantly worse than the best, the simplest is
taken; what is as simple and as good is kept as its equivalent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.common_speed import common_speed_candidates
from pipeline.discrepancy.decide_again import NEGLIGIBLE, decide_again
from pipeline.discrepancy.encoder_error import encoder_errors
from pipeline.discrepancy.found import Found, onsets_of, values_of
from pipeline.discrepancy.onset import since, with_onsets
from pipeline.discrepancy.plausibility import (
    BACKLASH,
    DELAY,
    SENSOR_BIAS,
    THERMAL_DRIFT,
    TIMING,
    complexity,
    is_at_bound,
    is_dependence,
    is_plausible,
    say_the_same,
)
from pipeline.discrepancy.refine import gain_without, refine, refine_alone
from pipeline.discrepancy.regression import t_statistic
from pipeline.discrepancy.screen import Candidate, Rows, screen
from pipeline.discrepancy.simulation import Simulation
from pipeline.discrepancy.stops import Encoder
from pipeline.discrepancy.whole_machine import (
    COMMON_CAUSES,
    ON_SEVERAL_JOINTS,
    WHOLE_MACHINE,
    are_equal_delays,
    common_cause,
    of_one_cause,
)
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


def null_gains(
    simulation: Simulation, rows: Rows, excluded: Sequence[str]
) -> dict[tuple[str, int, int | None], float]:
    """Gain per used row that each candidate has on nominal logs."""
    candidates = screen(simulation, {}, rows, excluded) + common_speed_candidates(simulation, {}, rows)
    n = len(rows.folds.fold)
    gains = {c.key: max(0.0, c.gain) / n for c in candidates}
    warming = [
        c
        for c in candidates
        if c.family == THERMAL_DRIFT and c.share > PRESENT_SHARE and t_statistic(c.gain_by_block) > PRESENT_T
    ]
    if len(warming) > 1 and is_plausible(THERMAL_DRIFT, warming):
        # Nominal logs that show it themselves are no evidence against it: the model, whose memory is short, lacks it.
        gains |= {key: 0.0 for key in gains if key[0] == THERMAL_DRIFT}
    return gains


class Search:
    """The state of a forward selection on one set of measured logs."""

    def __init__(
        self,
        simulation: Simulation,
        rows: Rows,
        null: Null,
        config: SearchConfig,
        excluded: Sequence[str],
        encoders: Mapping[int, Encoder],
        joints: Sequence[str],
        say: Callable[[str], None],
    ) -> None:
        self.simulation, self.rows, self.null, self.config = simulation, rows, null, config
        self.excluded = tuple(excluded)
        self.encoders = encoders
        self.joints = joints
        self.found: list[Found] = []
        self._closed: set[int] = set()  # joints on which nothing plausible is left
        self.first: list[Candidate] = []  # of the first screen, for the ranking
        self._say = say

    def net(self, candidate: Candidate) -> float:
        """Gain beyond what the candidate gains on nominal logs."""
        null = self.null.get(candidate.key, 0.0)
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
            and (t_statistic(candidate.gain_by_block) > smallest_t or self._is_reproduced(candidate))
        )

    def _is_reproduced(self, candidate: Candidate) -> bool:
        """Whether what either half of the rows was fitted to removes a good part of the other half's squares.

        What is large but rare has little to show in most blocks, and a large error by blocks.
        """
        if candidate.share <= 0.0 or candidate.onset is not None:
            return False
        return self._is_in_both_halves(candidate.gain_by_block, candidate.gain / candidate.share)

    def _is_in_both_halves(self, gain_by_block: np.ndarray, squares: float) -> bool:
        folds = self.rows.folds
        fold_of_block = np.zeros(folds.n_blocks, int)
        fold_of_block[folds.block] = folds.fold
        by_fold = np.bincount(fold_of_block, gain_by_block, minlength=2)
        return bool(by_fold.min() > 0.5 * REPRODUCED_SHARE * squares)

    def run(self) -> list[Found]:
        """Find effects until none is left that passes."""
        self.found = encoder_errors(
            self.simulation,
            self.rows,
            self.encoders,
            self.excluded,
            self.config.smallest_t,
            self.joints,
            self._say,
        )
        self.simulation.onsets = onsets_of(self.found)
        for _ in range(self.config.maximum_effects):
            candidates = self._candidates()
            if second := self._second_cause(candidates):
                self.found += second
                self._refit()
                continue
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
            self._split_common_delay()
        self._look_back()
        self.found = decide_again(self.simulation, self.rows, self.found, self.config.equivalent_t, self._say)
        return self.found

    def _split_common_delay(self) -> None:
        """Where all joints are late alike and one is later still, the channel is late, and that joint has more.

        Alone, the delay of that joint would hide the other effect, which is as late in the mean.
        """
        delays = [f for f in self.found if f.candidate.family == DELAY and f.candidate.onset is None]
        if len(delays) < max(3, self.simulation.setting.n_joint):
            return
        values = np.array([f.candidate.point["added_delay"] for f in delays])
        common = float(np.median(values))
        later = np.flatnonzero(values > common + max(LATER_S, LATER_SHARE * common))
        if len(later) != 1 or np.any(values < common - max(LATER_S, LATER_SHARE * common)):
            return
        joint = delays[later[0]].candidate.joint
        if sum(f.candidate.joint == joint for f in self.found) > 1:
            return
        present = self.found
        shortened = replace(delays[later[0]].candidate, point={"added_delay": common})
        self.found = [Found(shortened) if f is delays[later[0]] else f for f in present]
        left = screen(
            self.simulation, values_of(self.simulation, self.found), self.rows, self.excluded, [joint]
        )
        passing = [
            c for c in left if c.family != DELAY and self.passes(c) and not self._is_refuted_by_stops(c)
        ]
        if not passing:
            self.found = present
            return
        self.found += self._choose(passing, left)
        self._refit()

    def _second_cause(self, candidates: Sequence[Candidate]) -> list[Found]:
        """A payload or a shared pump, beside what makes the whole machine faster or slower.

        On single joints little that is left is worth a name then: no wrapper fits every joint so well. What joints
        bear each other out on is.
        """
        whole = sum(f.candidate.gain for f in self.found if f.candidate.family in COMMON_CAUSES)
        if not whole:
            return []
        for family in ON_SEVERAL_JOINTS:
            showing = [c for c in candidates if c.family == family and self._shows(c)]
            if (
                len(showing) > 1
                and is_plausible(family, showing)
                and any(map(self.passes, showing))
                and sum(map(self.net, showing)) > SECOND_CAUSE_SHARE * whole
            ):
                self._say(f"{family} on {len(showing)} joints is there besides")
                return [Found(c) for c in showing]
        return []

    def _may_stand_alone(self, candidate: Candidate, candidates: Sequence[Candidate]) -> bool:
        """Whether it is plausible on its joint, and oil that warms up shows on another joint, too."""
        if candidate.family == THERMAL_DRIFT:
            showing = [c for c in candidates if c.family == THERMAL_DRIFT and self._shows(c)]
            return len(showing) > 1 and is_plausible(candidate.family, [candidate])
        return candidate.family not in ON_SEVERAL_JOINTS or is_plausible(candidate.family, [candidate])

    def _candidates(self) -> list[Candidate]:
        active = values_of(self.simulation, self.found)
        candidates = screen(self.simulation, active, self.rows, self.excluded)
        if SUPPLY not in self.excluded and not any(f.candidate.family == SUPPLY for f in self.found):
            candidates += common_speed_candidates(self.simulation, active, self.rows)
        taken = {f.candidate.key for f in self.found}
        candidates = [c for c in candidates if c.key not in taken and not self._is_refuted_by_stops(c)]
        # What sets in at the same moment as an effect found before is one event.
        moments = list(onsets_of(self.found).values())
        candidates = self._since_its_onset(
            active, with_onsets(self.simulation, active, self.rows, candidates, moments)
        )
        if not self.first:
            self.first = sorted(candidates, key=self.net, reverse=True)
        return candidates

    def _since_its_onset(self, active: dict, candidates: list[Candidate]) -> list[Candidate]:
        """All candidates from the same moment on, where what explains most sets in at some moment."""
        best = max(candidates, key=self.net)
        if best.onset is None or t_statistic(best.gain_by_block) < SHOWS_T:
            return candidates
        known = {c.key: c for c in candidates}
        for candidate in since(self.simulation, active, self.rows, best, self.excluded):
            if candidate.key in known and candidate.gain > ONSET_FACTOR * known[candidate.key].gain:
                known[candidate.key] = candidate
        return list(known.values())

    def _is_refuted_by_stops(self, candidate: Candidate) -> bool:
        if candidate.family != SENSOR_BIAS:
            return False
        encoder = self.encoders.get(candidate.joint)
        # Play moves the stops, too: beside it they say nothing of the encoder.
        taken = any(
            f.candidate.family == BACKLASH and f.candidate.joint == candidate.joint for f in self.found
        )
        return taken or (encoder is not None and not encoder.allows(candidate.point))

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
                if c.joint == first.joint
                and is_dependence(c)
                and c.key not in {f.candidate.key for f in self.found}
                and self.passes(c)
            ]
            better = max(rivals, key=self.net, default=None)
            if (
                better is not None
                and not is_dependence(first)
                and self.net(better) > (1.0 + NEGLIGIBLE) * self.net(first)
            ):
                self._say(f"{better.family} explains more than {first.family} and what is left beside it")
                self.found[place] = Found(better, [], [(first, "leaves structure behind that this does not")])
                self._refit()
        return kept

    def _choose(self, passing: list[Candidate], candidates: list[Candidate]) -> list[Found]:
        """The joint with most to gain; the simplest of its candidates that are not significantly worse."""
        best = max(passing, key=self.net)
        if not any(
            f.candidate.family in COMMON_CAUSES for f in self.found
        ):  # a second would only mend the first
            common = common_cause(best, candidates, self.net, self._shows)
            if any(map(self.passes, common)):
                self._say(
                    f"{common[0].family} on {len(common)} joints explains more together than anything on one"
                )
                return [Found(c) for c in common]
        rivals = sorted((c for c in passing if c.joint == best.joint), key=self.net, reverse=True)
        rivals = self._refined(rivals[:REFINED]) + rivals[REFINED:]
        beyond = [is_at_bound(self.simulation.effects, rival) for rival in rivals]
        at_bound = [rival for rival, is_beyond in zip(rivals, beyond, strict=True) if is_beyond]
        rivals = [rival for rival, is_beyond in zip(rivals, beyond, strict=True) if not is_beyond]
        if not rivals:
            self._say(
                f"{self.joints[best.joint]}: what explains most is {best.family} beyond any plausible value"
            )
            self._closed.add(best.joint)
            return []
        best = max(rivals, key=self.net)
        as_good = self._as_good_as(best, rivals)
        chosen = min(as_good, key=lambda c: (complexity(c), -self.net(c)))
        equivalents = [
            c
            for c in as_good
            if c.family != chosen.family
            and complexity(c) < complexity(chosen) + AS_SIMPLE
            and not say_the_same(c, chosen)
        ]
        equivalents += [c for c in as_good if self._raises_doubt(c, chosen)]
        # What explains clearly more, if only with a value that is not plausible, says that the name chosen is not it.
        equivalents += [c for c in at_bound if self.net(c) > DOUBT_FACTOR * self.net(chosen)]
        better = self._better_dependence(chosen, as_good)
        if better is not None:  # a wrong name is worse than none
            chosen, equivalents = better, [chosen, *(c for c in equivalents if c is not better)]
        self._say(
            f"{chosen.family} on {self.joints[chosen.joint]}: removes {chosen.share:.0%} of the squared residual there"
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
        if chosen.family == DELAY and chosen.onset is None and TIMING not in self.excluded:
            found += [Found(c) for c in self._late_elsewhere(chosen, candidates)]
        return found

    def _late_elsewhere(self, chosen: Candidate, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Delays of the other joints, where each of them shows one that is as large: one channel that is late."""
        known = [f.candidate for f in self.found if f.candidate.family == DELAY]
        delays = []
        for joint in set(range(self.simulation.setting.n_joint)) - {c.joint for c in (chosen, *known)}:
            of_joint = [c for c in candidates if c.joint == joint]
            delay = next((c for c in of_joint if c.family == DELAY and c.onset is None), None)
            if delay is None or not self._shows(delay) or self._is_worse(delay, max(of_joint, key=self.net)):
                return []
            delays.append(delay)
        delays = self._refined(delays)
        if not delays or not are_equal_delays([chosen, *known, *delays]):
            return []
        self._say("all other joints are as late: the channel is")
        return delays

    def _as_good_as(self, best: Candidate, rivals: Sequence[Candidate]) -> list[Candidate]:
        """Those that are not worse than the best of all, nor a name worse than the best of names."""
        as_good = [c for c in rivals if not self._is_worse(c, best)]
        names = [c for c in as_good if not is_dependence(c)]
        if not names:
            return as_good
        best_name = max(names, key=self.net)
        return [c for c in as_good if is_dependence(c) or not self._is_worse(c, best_name)]

    def _better_dependence(self, chosen: Candidate, as_good: Sequence[Candidate]) -> Candidate | None:
        """The dependence, if any, that explains clearly more than the name chosen."""
        if is_dependence(chosen):
            return None
        others = [c for c in as_good if is_dependence(c)]
        best = max(others, key=self.net, default=None)
        if best is None or self.net(best) < DOUBT_FACTOR * self.net(chosen):
            return None
        return best if t_statistic(best.gain_by_block - chosen.gain_by_block) > DOUBT_T else None

    def _raises_doubt(self, candidate: Candidate, chosen: Candidate) -> bool:
        """Whether it is a dependence, of more freedom, that explains more than the name chosen."""
        return (
            is_dependence(candidate)
            and not is_dependence(chosen)
            and self.net(candidate) > (1.0 + NEGLIGIBLE) * self.net(chosen)
        )

    def _refined(self, candidates: list[Candidate]) -> list[Candidate]:
        """Candidates moved off their grids; those that are linear stay."""
        return [
            c if c.family == SUPPLY else refine_alone(self.simulation, self.rows, self.found, c)
            for c in candidates
        ]

    def _shows(self, candidate: Candidate) -> bool:
        """Whether an effect that other joints have too can be seen on this one; weaker than `passes`."""
        return (
            self.net(candidate) > 0.0
            and candidate.share > 0.5 * self.config.smallest_share
            and t_statistic(candidate.gain_by_block) > SHOWS_T
        )

    def _is_worse(self, candidate: Candidate, best: Candidate) -> bool:
        if self.net(candidate) < LEAST_OF_BEST * self.net(best):
            return True  # whatever the scatter: few blocks may hold all there is to see of a rare effect
        if is_dependence(best) and not is_dependence(candidate):
            # Flexible as it is, it mends what any name idealises: it comes first only if it explains clearly more.
            is_clear = self.net(best) > DOUBT_FACTOR * self.net(candidate)
            return is_clear and self._is_surely_worse(candidate, best)
        return self._is_surely_worse(candidate, best)

    def _is_surely_worse(self, candidate: Candidate, best: Candidate) -> bool:
        difference = best.gain_by_block - candidate.gain_by_block
        allowance = self.null.get(best.key, 0.0) * len(self.rows.folds.fold)
        significant = t_statistic(difference) > self.config.equivalent_t
        return bool(significant and difference.sum() > max(allowance, NEGLIGIBLE * best.gain))

    def _refit(self) -> None:
        self.found = refine(self.simulation, self.rows, [self._complete(f) for f in self.found])

    def _complete(self, found: Found) -> Found:
        """With the parameters that belong to an effect, but do not make it known."""
        candidate = found.candidate
        if candidate.family == SUPPLY:
            return found
        later = tuple(
            one
            for one in self.simulation.effects[candidate.family].freed_later()
            if one not in candidate.freed
        )
        coefficients = np.append(candidate.coefficients, np.zeros(len(later)))
        return replace(
            found, candidate=replace(candidate, freed=candidate.freed + later, coefficients=coefficients)
        )

    def _look_back(self) -> None:
        """Drop what the others made superfluous."""
        kept, n_joint = list(self.found), self.simulation.setting.n_joint
        for found in sorted(kept, key=lambda f: -complexity(f.candidate)):
            if len(kept) == 1 or found.candidate.family == SUPPLY or found.candidate.deviation is not None:
                continue
            if found.candidate.family in of_one_cause([f.candidate for f in kept], n_joint):
                continue  # one cause, which the gate judges as one
            by_block = gain_without(self.simulation, self.rows, kept, found)
            squares = found.candidate.gain / max(found.candidate.share, 1e-9)
            is_sure = t_statistic(by_block) >= self.config.smallest_t or self._is_in_both_halves(
                by_block, squares
            )
            if by_block.sum() < 0.4 * self.config.smallest_share * squares or not is_sure:
                kept.remove(found)
                self._say(
                    f"{found.candidate.family} on {self.joints[found.candidate.joint]} is superfluous beside the others"
                )
        if len(kept) != len(self.found):
            self.found = kept
            self._refit()


LATER_S, LATER_SHARE = 0.02, 0.1  # than the other joints, of a joint that has another effect besides
PRESENT_SHARE, PRESENT_T = 0.1, 2.5  # of an effect that the nominal logs have, too
REPRODUCED_SHARE = 0.2
LEAST_OF_BEST = 0.5  # of what the best explains, for a candidate to be as good
REFINED = 3  # of a joint's candidates
ONSET_FACTOR = 1.2  # times the gain without onset
SHOWS_T = 1.5
COMMON_T = 2.0  # what all joints have in common may lie in few blocks, and joints bear each other out
WHOLE_SECOND_SHARE = 0.5
SECOND_CAUSE_SHARE = 0.12  # of what the first explains on all its joints
AS_SIMPLE = 0.4
DOUBT_FACTOR, DOUBT_T = 1.1, 1.0


def _why(rival: Candidate, chosen: Candidate, best: Candidate) -> str:
    if complexity(rival) > complexity(chosen) and rival.gain <= 1.02 * best.gain:
        return f"removes {rival.share:.0%} with more freedom, {chosen.family} {chosen.share:.0%} with less"
    return f"removes {rival.share:.0%} of the squared residual, {chosen.family} {chosen.share:.0%}"
