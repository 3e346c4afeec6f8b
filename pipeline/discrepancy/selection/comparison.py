"""What a candidate explains, and which of two explains more: by gains on held-out rows, block by block."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.families.plausibility import (
    CHANNEL,
    GAIN,
    LEAKAGE,
    SENSOR_BIAS,
    complexity,
    depends_alike,
    is_dependence,
)
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import SHOWN_T, Folds, t_statistic
from pipeline.discrepancy.selection.search_thresholds import EffectSearchConfig

NEGLIGIBLE = 0.015  # of the gain: too small a difference to decide between names
REPRODUCED_SHARE = 0.2
# Of what the best explains, for a candidate to be as good: in general, and for a name beside a better name, which has
# no more freedom.
LEAST_OF_BEST, LEAST_OF_BEST_NAME = 0.5, 0.7
AS_SIMPLE = 0.4
DOUBT_FACTOR = 1.1
BETTER_FACTOR, BETTER_T = 1.06, 1.0  # of a dependence, to come before a name
LAST_RESORT_FACTOR = 1.2  # of a course in time, to come before anything: it follows whatever varies slowly


@dataclass(frozen=True)
class Comparison:
    """Of candidates on the same rows.

    Attributes:
        folds: Of the rows in use.
        config: Thresholds.
        at_rest: Per joint, the noise floor at rest, in units of that of all rows; empty: as high.
    """

    folds: Folds
    config: EffectSearchConfig
    at_rest: tuple[float, ...] = ()

    def net(self, candidate: Candidate) -> float:
        """Gain beyond what the candidate owes to the diagnosis model's misfit."""
        return candidate.gain - candidate.owed

    def worth(self, candidate: Candidate) -> float:
        """The factor on what a candidate explains by which its share is found: one more of complexity costs as much
        as decides nothing between names.
        """
        return float((1.0 + NEGLIGIBLE) ** -complexity(candidate))

    def passes(self, candidate: Candidate, is_further: bool = False) -> bool:
        """Whether it removes enough, beyond chance and beyond the model's own misfit.

        Args:
            candidate: Any.
            is_further: Whether something was found before, of which it may be what is left over.
        """
        squares = candidate.gain / candidate.share if candidate.share > 0 else np.inf
        smallest_t = self.config.second_t if is_further else self.config.smallest_t
        return (
            candidate.share > self.config.smallest_share
            and self.net(candidate)
            > max(self.config.smallest_share * squares, self._smallest_gain(candidate))
            and (_t(candidate) > smallest_t or self._is_reproduced(candidate))
        )

    def _smallest_gain(self, candidate: Candidate) -> float:
        """By the noise floor where the effect acts: a creep stands out at rest, and moves positions for as long."""
        is_at_rest = candidate.family == LEAKAGE and self.at_rest
        floor = self.at_rest[candidate.joint] if is_at_rest else 1.0
        return self.config.smallest_gain * len(self.folds.fold) * floor

    def shows(self, candidate: Candidate) -> bool:
        """Whether an effect that other joints have too can be seen on this one; weaker than `passes`."""
        return (
            self.net(candidate) > 0.0
            and candidate.share > 0.5 * self.config.smallest_share
            and _t(candidate) > SHOWN_T
        )

    def is_more_than_a_gain(self, candidate: Candidate, candidates: Sequence[Candidate]) -> bool:
        """Whether it explains clearly more than a gain of its joint: what hardly varies is as good as one."""
        gain = next((c for c in candidates if c.family == GAIN and c.joint == candidate.joint), None)
        return gain is None or (
            self.net(candidate) > DOUBT_FACTOR * self.net(gain)
            and t_statistic(candidate.gain_by_block - gain.gain_by_block) > SHOWN_T
        )

    def _is_reproduced(self, candidate: Candidate) -> bool:
        """Whether what either half of the rows was fitted to removes a good part of the other half's squares.

        What is large but rare has little to show in most blocks, and a large error by blocks.
        """
        if candidate.share <= 0.0 or candidate.onset is not None:
            return False
        return self.is_in_both_halves(candidate.gain_by_block, candidate.gain / candidate.share)

    def is_in_both_halves(self, gain_by_block: np.ndarray, squares: float) -> bool:
        """Whether either half of the rows has its part of a gain, which is a good share of the `squares` before."""
        fold_of_block = np.zeros(self.folds.n_blocks, int)
        fold_of_block[self.folds.block] = self.folds.fold
        by_fold = np.bincount(fold_of_block, gain_by_block, minlength=2)
        return bool(by_fold.min() > 0.5 * REPRODUCED_SHARE * squares)

    def is_worse(self, candidate: Candidate, best: Candidate) -> bool:
        """Whether a candidate explains less than the best, beyond scatter and beyond what a name idealises."""
        both_named = not is_dependence(candidate) and not is_dependence(best)
        least = LEAST_OF_BEST_NAME if both_named else LEAST_OF_BEST
        if self.net(candidate) < least * self.net(best):
            return True  # whatever the scatter: few blocks may hold all there is to see of a rare effect
        if best.family == COURSE and candidate.family != COURSE:
            is_clear = self.net(best) > LAST_RESORT_FACTOR * self.net(candidate)
            return is_clear and self._is_surely_worse(candidate, best)
        if is_dependence(best) and not is_dependence(candidate):
            # Flexible as it is, it mends what any name idealises: it comes first only if it explains clearly more.
            is_clear = self.net(best) > DOUBT_FACTOR * self.net(candidate)
            return is_clear and self._is_surely_worse(candidate, best)
        return self._is_surely_worse(candidate, best)

    def _is_surely_worse(self, candidate: Candidate, best: Candidate) -> bool:
        difference = best.gain_by_block - candidate.gain_by_block
        significant = t_statistic(difference) > self.config.equivalent_t
        return bool(significant and difference.sum() > max(best.owed, NEGLIGIBLE * best.gain))

    def as_good_as(self, best: Candidate, rivals: Sequence[Candidate]) -> list[Candidate]:
        """Those that are not worse than the best of all, nor a name worse than the best of names."""
        as_good = [c for c in rivals if not self.is_worse(c, best)]
        others = [c for c in as_good if c.family != COURSE]
        if best.family == COURSE and others:
            rivals = [c for c in rivals if c.family != COURSE]
            return [*self.as_good_as(max(others, key=self.net), rivals), best]
        names = [c for c in as_good if not is_dependence(c)]
        if not names:
            return as_good
        best_name = max(names, key=self.net)
        return [c for c in as_good if is_dependence(c) or not self.is_worse(c, best_name)]

    def simplest(self, as_good: Sequence[Candidate]) -> Candidate:
        """The simplest of equally good candidates; of equally simple ones the best."""
        return min(as_good, key=lambda c: (complexity(c), -self.net(c)))

    def equivalents(
        self,
        chosen: Candidate,
        as_good: Sequence[Candidate],
        rivals: Sequence[Candidate],
        at_bound: Sequence[Candidate],
    ) -> list[Candidate]:
        """What takes the certainty from the candidate chosen.

        Args:
            chosen: Of `as_good`.
            as_good: Candidates that are not worse than the best.
            rivals: All candidates on the joint.
            at_bound: Those that explain the logs with a value beyond what is plausible.
        """
        equivalents = [
            c
            for c in as_good
            if (c.family != chosen.family or (c.family == CHANNEL and c.source != chosen.source))
            and complexity(c) < complexity(chosen) + AS_SIMPLE
        ]
        equivalents += [c for c in as_good if self.raises_doubt(c, chosen)]
        if chosen.family == SENSOR_BIAS:
            # By speeds alone a scale is a gain, but for how far these depend on the place: stops tell, and say more
            # than speeds where they were met.
            least = LEAST_OF_BEST_NAME * self.net(chosen)
            equivalents += [c for c in rivals if c.family == GAIN and self.net(c) > least]
        # What explains clearly more, if only with a value that is not plausible, says that the name chosen is not it.
        equivalents += [c for c in at_bound if self.net(c) > DOUBT_FACTOR * self.net(chosen)]
        return list({c.key: c for c in equivalents}.values())

    def raises_doubt(self, candidate: Candidate, chosen: Candidate) -> bool:
        """Whether, with more freedom, it is a dependence that explains more than the name chosen, or a better name.

        A dependence on what the name depends on, too, says but that its form is idealised.
        """
        if is_dependence(chosen):
            return False
        is_flexible = is_dependence(candidate) and candidate.family != COURSE
        is_flexible = is_flexible and not depends_alike(candidate, chosen)
        factor = 1.0 + NEGLIGIBLE if is_flexible else DOUBT_FACTOR
        return self.net(candidate) > factor * self.net(chosen)

    def better_dependence(self, chosen: Candidate, as_good: Sequence[Candidate]) -> Candidate | None:
        """The dependence, if any, that explains clearly more than the name chosen."""
        if is_dependence(chosen):
            return None
        others = [c for c in as_good if is_dependence(c)]
        best = max(others, key=self.as_last_resort, default=None)
        if best is None:
            return None
        factor = DOUBT_FACTOR if depends_alike(best, chosen) else BETTER_FACTOR
        if self.as_last_resort(best) < factor * self.net(chosen):
            return None
        return best if t_statistic(best.gain_by_block - chosen.gain_by_block) > BETTER_T else None

    def as_last_resort(self, candidate: Candidate) -> float:
        """What it explains, of a course in time as much less as it has to explain more."""
        return self.net(candidate) / (LAST_RESORT_FACTOR if candidate.family == COURSE else 1.0)

    def names_instead(self, dependence: Candidate, as_good: Sequence[Candidate]) -> list[Candidate]:
        """Names that explain no less than a dependence does, if with more freedom than the simplest name."""
        return [c for c in as_good if not is_dependence(c) and self.net(c) >= self.net(dependence)]


def _t(candidate: Candidate) -> float:
    """Of its gain by blocks; a dependence is so flexible that it follows whatever the few after a moment hold."""
    return t_statistic(candidate.gain_by_block) if is_dependence(candidate) else candidate.t


def why_not(rival: Candidate, chosen: Candidate, best: Candidate) -> str:
    """Why a rival lost, in a clause."""
    if complexity(rival) > complexity(chosen) and rival.gain <= 1.02 * best.gain:
        return (
            f"removes {rival.share:.0%} of the squared residual with more freedom, "
            f"{chosen.family} {chosen.share:.0%} with less"
        )
    return f"removes {rival.share:.0%} of the squared residual, {chosen.family} {chosen.share:.0%}"
