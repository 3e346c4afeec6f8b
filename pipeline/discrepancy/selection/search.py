"""Forward selection of effects: screen, take the simplest of the best, refine, look again, and at last look back.

Effects that the given model has already are there from the start, and fitted beside what is new.

A candidate's gain is compared with what the same candidate gains on the nominal logs, where there is nothing to find
but the diagnosis model's own misfit. Among those that are not significantly worse than the best, the simplest is
taken; what is as simple and as good is kept as its equivalent (`comparison.py`).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.encoder_error import encoder_errors, is_refuted_by_stops
from pipeline.discrepancy.families.late_channel import late_channel, set_in_together
from pipeline.discrepancy.families.plausibility import (
    CHANNEL,
    DELAY,
    GAIN,
    THERMAL_DRIFT,
    TIMING,
    complexity,
    is_at_bound,
    is_dependence,
    is_plausible,
)
from pipeline.discrepancy.families.stops import Encoder
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.uncorrectable import WITHOUT_WRAPPER, has_wrapper, screen_without_wrapper
from pipeline.discrepancy.families.whole_machine import (
    COMMON_CAUSES,
    COMMON_FACTOR,
    OF_ONE_CAUSE,
    ON_SEVERAL_JOINTS,
    WHOLE_MACHINE,
    common_causes,
    of_one_cause,
    worth_of,
)
from pipeline.discrepancy.selection.candidate import Candidate, Nominal
from pipeline.discrepancy.selection.comparison import Comparison, why_not
from pipeline.discrepancy.selection.known.known_effects import as_known, with_encoders
from pipeline.discrepancy.selection.known.what_is_left import Left, as_it_was, what_is_left
from pipeline.discrepancy.selection.onset import SMALLEST_GAIN, of_one_moment, since, with_onsets
from pipeline.discrepancy.selection.refine import (
    completed,
    gain_without,
    refine,
    refine_alone,
    with_gains,
)
from pipeline.discrepancy.selection.regression import SHOWN_T, SURE_T, t_statistic
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.search_thresholds import EffectSearchConfig
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from pipeline.discrepancy.selection.shares import credible, shares_of

REFINED = 3  # of a joint's candidates
TOLD_LOSERS = 6  # of a joint's candidates
WHOLE_SECOND_SHARE = 0.5
REST_SHARE = 0.4  # net, of the squares that earlier effects leave, for a name that is not refined yet
STILL_SHARE = 0.4  # of the smallest share, that an effect has to do beside the others


class Search:
    """The state of a forward selection on one set of measured logs."""

    def __init__(
        self,
        simulation: Simulation,
        rows: ScoredRows,
        nominal: Nominal,
        config: EffectSearchConfig,
        excluded: Sequence[str],
        encoders: Mapping[int, Encoder],
        joints: Sequence[str],
        excited: Collection[int],
        log: Callable[[str], None],
        present: Collection[str] = (),
        at_rest: Sequence[float] = (),
        known: Sequence[SelectedEffect] = (),
    ) -> None:
        self.simulation, self.rows, self.config = simulation, rows, config
        self.nominal, self.present = nominal, present
        self.comparison = Comparison(rows.folds, config, tuple(at_rest))
        self.excluded = tuple(excluded)
        self.encoders = encoders
        self.joints, self.excited = joints, excited
        self.known = known  # of the given model
        self.found: list[SelectedEffect] = []
        self._closed: set[int] = set()  # joints on which nothing plausible is left
        self.first: list[Candidate] = []  # of the first screen, for the ranking
        self._log = log

    def passes(self, candidate: Candidate) -> bool:
        """Whether it removes enough, beside what was found."""
        return self.comparison.passes(candidate, is_further=bool(self.found))

    def run(self) -> list[SelectedEffect]:
        """Find effects until none is left that passes."""
        self._select()
        self._look_back()
        self._ask_of_known()
        return as_known(self.found, self.known)

    def _select(self) -> None:
        """Forward, from what encoders say and the given model has."""
        seen = encoder_errors(
            self.simulation,
            self.rows,
            self.encoders,
            self.excluded,
            self.joints,
            self._log,
        )
        self.found = with_encoders(self.known, seen, self.encoders)
        if self.known:
            self.found = with_gains(self.simulation, self.rows, self._refitted(self.found))
        for _ in range(self.config.maximum_effects):
            candidates = self._candidates()
            passing = [candidate for candidate in candidates if self.passes(candidate)]
            if any(f.candidate.family in COMMON_CAUSES for f in self.found):
                passing = [c for c in passing if c.family not in COMMON_CAUSES]
            passing = [c for c in passing if self._may_stand_alone(c, candidates) and not self._is_repair(c)]
            closed = self._closed | {f.candidate.joint for f in self.found if f.candidate.family == COURSE}
            passing = [c for c in passing if c.joint not in closed]  # nothing takes a course off what is left
            if not passing:
                break
            self.found += self._choose(passing, candidates)
            self._refit()
            # One cause sets in once, on all its joints.
            self.found = of_one_moment(self.simulation, self.rows, self.found, OF_ONE_CAUSE)

    def _may_stand_alone(self, candidate: Candidate, candidates: Sequence[Candidate]) -> bool:
        """Whether it is plausible on its joint, and shows on another joint, too, where all have the same oil."""
        if candidate.family in (THERMAL_DRIFT, SUPPLY):
            showing = [c for c in candidates if c.family == candidate.family and self.comparison.shows(c)]
            return len(showing) > 1 and is_plausible(candidate.family, [candidate])
        is_judged = candidate.family in (GAIN, *ON_SEVERAL_JOINTS)
        return not is_judged or is_plausible(candidate.family, [candidate])

    def _candidates(self) -> list[Candidate]:
        active = hypothesis_of(self.simulation, self.found)
        candidates = screen(self.simulation, active, self.rows, self.excluded, nominal=self.nominal)
        # No wrapper takes a common change off what is left: neither it nor a joint's own course is to be sought there.
        is_supply_known = any(f.candidate.family == SUPPLY for f in self.found)
        excluded = WITHOUT_WRAPPER if is_supply_known else self.excluded
        candidates += screen_without_wrapper(self.simulation, active, self.rows, excluded, self.nominal)
        taken = {f.candidate.key for f in self.found}
        candidates = [c for c in candidates if c.key not in taken and not self._is_refuted_by_stops(c)]
        candidates = [
            c for c in candidates if c.family != CHANNEL or self.comparison.is_more_than_a_gain(c, candidates)
        ]
        # What sets in at the same moment as an effect found before is one event.
        moments = list(active.onsets.values())
        candidates = self._since_its_onset(
            active, with_onsets(self.simulation, active, self.rows, candidates, moments)
        )
        if not self.first:
            self.first = sorted(candidates, key=self.comparison.net, reverse=True)
        return candidates

    def _since_its_onset(self, active: Hypothesis, candidates: list[Candidate]) -> list[Candidate]:
        """All candidates from the same moment on, where what explains most sets in at some moment."""
        best = max(filter(has_wrapper, candidates), key=self.comparison.net)
        if best.onset is None or best.t < SHOWN_T:
            return candidates
        known = {c.key: c for c in candidates}
        for candidate in since(self.simulation, active, self.rows, best, self.excluded, self.nominal):
            if candidate.key in known and candidate.gain > SMALLEST_GAIN * known[candidate.key].gain:
                known[candidate.key] = candidate
        return list(known.values())

    def _is_refuted_by_stops(self, candidate: Candidate) -> bool:
        return is_refuted_by_stops(candidate, self.encoders, self.found, self.excluded)

    def _is_repair(self, candidate: Candidate) -> bool:
        """Whether it only mends an effect that was found on its joint, or on the whole machine, before."""
        squares = candidate.gain / candidate.share
        if self.comparison.net(candidate) > REST_SHARE * squares and not is_dependence(candidate):
            return False  # what one cause leaves is seldom of a simple form: a name that explains most is a second one
        found = [f.candidate for f in self.found]
        whole = max((c.gain for c in found if c.family in WHOLE_MACHINE), default=0.0)
        if candidate.gain < WHOLE_SECOND_SHARE * whole:
            return True  # no wrapper of the whole machine fits every joint so well that nothing is left
        first = next((c for c in found if c.joint == candidate.joint), None)
        if first is None or first.family in COMMON_CAUSES:
            return False
        return candidate.gain <= self.config.second_share * first.gain

    def _choose(self, passing: list[Candidate], candidates: list[Candidate]) -> list[SelectedEffect]:
        """The joint with most to gain; the simplest of its candidates that are not significantly worse."""
        best = max(passing, key=self.comparison.as_last_resort)
        # A second common cause would only mend the first.
        if not any(f.candidate.family in COMMON_CAUSES for f in self.found):
            common = common_causes(best, candidates, self.comparison.net, self.comparison.shows)
            if common and any(map(self.passes, common[0])):
                return self._in_common(common, best)
        rivals = sorted((c for c in passing if c.joint == best.joint), key=self.comparison.net, reverse=True)
        foremost = [c for c in rivals if has_wrapper(c)][:REFINED]
        rivals = self._refined(foremost) + [c for c in rivals if not any(c is one for one in foremost)]
        beyond = [is_at_bound(self.simulation.effects, rival) for rival in rivals]
        at_bound = [rival for rival, is_beyond in zip(rivals, beyond, strict=True) if is_beyond]
        rivals = [rival for rival, is_beyond in zip(rivals, beyond, strict=True) if not is_beyond]
        if not rivals:
            self._log(
                f"{self.joints[best.joint]}: what explains most is {best.family} beyond any plausible value"
            )
            self._closed.add(best.joint)
            return []
        best = max(rivals, key=self.comparison.net)
        as_good = self.comparison.as_good_as(best, rivals)
        chosen = self.comparison.simplest(as_good)
        equivalents = self.comparison.equivalents(chosen, as_good, rivals, at_bound)
        better = self.comparison.better_dependence(chosen, as_good)
        if better is not None:  # a wrong name is worse than none, but not a name that explains as much
            named = self.comparison.names_instead(better, as_good)
            better = self.comparison.simplest(named) if named else better
            chosen, equivalents = better, [chosen, *(c for c in equivalents if c is not better)]
        worth = [self.comparison.worth(c) for c in rivals]
        shares = shares_of([[c] for c in rivals], worth)
        missing = credible(shares, [chosen.key, *(c.key for c in equivalents)])
        equivalents += [c for c in rivals if c.key in missing]
        self._log(
            f"{chosen.family} on {self.joints[chosen.joint]}: removes {chosen.share:.0%} of the squared residual there"
            + (f"; as good: {', '.join(c.family for c in equivalents)}" if equivalents else "")
        )
        losers = [
            (rival, why_not(rival, chosen, best))
            for rival in sorted(rivals, key=self.comparison.net, reverse=True)
            if rival.key not in {chosen.key, *(c.key for c in equivalents)}
        ]
        found = [SelectedEffect(chosen, equivalents, losers[:TOLD_LOSERS], shares=shares)]
        if chosen.family in WHOLE_MACHINE:
            # An effect of the whole machine is taken on every joint on which it shows.
            found += [
                SelectedEffect(c)
                for c in candidates
                if c.family == chosen.family
                and c.joint != chosen.joint
                and c.source == chosen.source
                and self.comparison.shows(c)
            ]
        if chosen.family == DELAY and TIMING not in self.excluded:
            found += [SelectedEffect(c) for c in self._late_elsewhere(chosen, candidates)]
        return found

    def _in_common(self, options: Sequence[Sequence[Candidate]], best: Candidate) -> list[SelectedEffect]:
        """The likeliest cause of several joints, beside other such causes and the best effect on one joint."""
        (first, *others), *_ = options
        self._log(f"{first.family} on {len(options[0])} joints explains more together than anything on one")
        rivals = options if any(of[0].key == best.key for of in options) else [*options, [best]]
        alone = COMMON_FACTOR * worth_of(first.family)  # as where it was chosen
        shares = shares_of(rivals, [worth_of(of[0].family) if len(of) > 1 else alone for of in rivals])
        missing = credible(shares, [first.key])
        equivalents = [of[0] for of in rivals if of[0].key in missing]
        return [SelectedEffect(first, equivalents, shares=shares), *map(SelectedEffect, others)]

    def _late_elsewhere(self, chosen: Candidate, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Delays of the other joints, where each that moves enough shows one that is as large: a late channel."""
        known = [f.candidate for f in self.found if f.candidate.family == DELAY]
        delays = []
        for joint in sorted({c.joint for c in candidates} - {c.joint for c in (chosen, *known)}):
            of_joint = [c for c in candidates if c.joint == joint]
            delay = next((c for c in of_joint if c.family == DELAY and set_in_together(c, chosen)), None)
            if (
                delay is not None
                and self.comparison.shows(delay)
                and not self.comparison.is_worse(delay, max(of_joint, key=self.comparison.net))
            ):
                delays.append(replace(delay, onset=chosen.onset, onset_between=chosen.onset_between))
            elif joint in self.excited:
                return []
        delays = self._refined(delays)
        channel = {c.joint for c in late_channel([chosen, *known, *delays], self.excited)}
        late = [delay for delay in delays if delay.joint in channel]
        if late:
            self._log("the other joints are as late: the channel is")
        return late

    def _refined(self, candidates: list[Candidate]) -> list[Candidate]:
        """Candidates moved off their grids; those that are linear stay."""
        return [
            refine_alone(self.simulation, self.rows, self.found, c) if has_wrapper(c) else c
            for c in candidates
        ]

    def _refit(self) -> None:
        self.found = self._refitted(self.found)

    def _refitted(self, found: Sequence[SelectedEffect]) -> list[SelectedEffect]:
        whole = [replace(f, candidate=completed(self.simulation, f.candidate, self.present)) for f in found]
        return refine(self.simulation, self.rows, whole)

    def _look_back(self) -> None:
        """Drop what the others made superfluous."""
        kept = list(self.found)
        for found in sorted(kept, key=lambda f: -complexity(f.candidate)):
            is_given = found.known is not None or found.candidate.deviation is not None
            if len(kept) == 1 or not has_wrapper(found.candidate) or is_given:
                continue
            if found.candidate.family in of_one_cause([f.candidate for f in kept], self.excited):
                continue  # one cause, which the gate judges as one
            if not self._does_something(found, kept):
                kept.remove(found)
                self._log(
                    f"{found.candidate.family} on {self.joints[found.candidate.joint]} is superfluous beside the others"
                )
        if len(kept) != len(self.found):
            self.found = kept
            self._refit()

    def _does_something(self, found: SelectedEffect, beside: Sequence[SelectedEffect]) -> bool:
        """Whether it takes enough off the squares beside the others, and not by chance."""
        by_block = gain_without(self.simulation, self.rows, beside, found)
        squares = found.candidate.gain / max(found.candidate.share, 1e-9)
        is_sure = t_statistic(by_block) >= SURE_T or self.comparison.is_in_both_halves(by_block, squares)
        return is_sure and by_block.sum() >= STILL_SHARE * self.config.smallest_share * squares

    def _ask_of_known(self) -> None:
        """Drop known effects that are gone; those of which these logs say nothing stay as they were."""
        kept = []
        for effect in self.found:
            left = Left.there if effect.known is None else self._left_of(effect)
            if left is not Left.there:
                where = self.joints[effect.candidate.joint]
                self._log(f"{effect.candidate.family} on {where}, which the given model has, is {left.name}")
            if left is not Left.gone:
                kept.append(as_it_was(effect) if left is Left.unseen else effect)
        is_any_gone = len(kept) < len(self.found)
        self.found = kept
        if is_any_gone:
            self._refit()

    def _left_of(self, known: SelectedEffect) -> Left:
        if known.candidate.deviation is not None:  # seen at the stops
            return Left.there
        if known.candidate.joint not in self.excited:
            return Left.unseen
        does_something = partial(self._does_something, beside=self.found)
        return what_is_left(self.simulation, self.rows, self.found, known, does_something)
