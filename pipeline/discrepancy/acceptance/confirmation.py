"""What confirmation rows, opened once, say of the effects that the search found, one effect on one joint at a time."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from pipeline.discrepancy.acceptance.agreement import Size, agree, sizes_by_log
from pipeline.discrepancy.acceptance.gate import GateConfig, lower_bound, pooled, rank_p, where_it_acts
from pipeline.discrepancy.acceptance.placebos import can_be_shifted, explains_other_joints, placebo_p
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, averaged
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.stops import Encoder
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import supply_p, without_common_change
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.time_varying_gain import beyond_constants
from pipeline.discrepancy.families.whole_machine import of_one_cause
from pipeline.discrepancy.selection.candidate import Key
from pipeline.discrepancy.selection.onset import rows_since
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of, residual_of

WithoutSupply = Mapping[int, tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Per joint (N,) residuals on confirmation rows with a common change of speed, with it taken off, and which rows count:
those after it has surely set in."""

ENCODER_LOSS = 0.02  # of the squares, that an encoder's error seen at the stops may cost the speeds


@dataclass(frozen=True)
class Confirmed:
    """Of one effect on one joint.

    Attributes:
        share: Of the squared residual on confirmation rows that it removes.
        bound: Lower bound of what is asked of it: of the share, or, if that is more, of what its cause removes on all
            its joints.
        p_value: After correction for all that was searched.
        is_confirmed: Whether it passes the gate.
        is_pooled: Whether it is its joints together whose bound that is.
        sizes: Of the fitted one, in the logs that show it, where it is asked that they agree.
        is_local: Whether it is the bound where the effect acts, which it seldom does.
    """

    share: float
    bound: float
    p_value: float
    is_confirmed: bool
    is_pooled: bool
    sizes: Sequence[Size] = ()
    is_local: bool = False


class Seen(NamedTuple):
    """What is asked of every effect.

    Attributes:
        share: Of the squared residual that it explains on confirmation rows.
        bound: Lower bound of it.
        p_value: After correction.
        largest_p: That is allowed.
        sizes: In single logs; of what has no wrapper, nothing is asked.
        is_local: Whether the bound is that of the rows where it acts.
    """

    share: float
    bound: float
    p_value: float
    largest_p: float
    sizes: Sequence[Size] = ()
    is_local: bool = False


@dataclass(frozen=True)
class Confirmation:
    """The rows and all that was known before they were opened.

    Attributes:
        simulation: On the measured logs.
        fitted: Rows for fitting and selection.
        held_out: Confirmation rows.
        encoders: By the stops that were met on `fitted`.
        config: Thresholds.
        n_hypotheses: That were searched.
        excited: Joints that move enough to tell.
        n_joint: Number of joints.
        seed: Of resampling.
    """

    simulation: Simulation
    fitted: ScoredRows
    held_out: ScoredRows
    encoders: Mapping[int, Encoder]
    config: GateConfig
    n_hypotheses: int
    excited: Collection[int]
    n_joint: int
    seed: int

    def judge(self, found: Sequence[SelectedEffect]) -> list[Confirmed]:
        """One judgement per effect, beside all others."""
        with_all = self._residual(self.held_out, found), self._residual(self.fitted, found)
        without_supply = self._without_common_change(found)
        without_wrapper = {**self._supply(found, without_supply), **self._courses(found)}
        together = self._together(found, with_all[0], without_supply)
        seen = [
            without_wrapper.get(f.candidate.key) or self._beside_others(f, found, with_all) for f in found
        ]
        smallest_p: dict[str, float] = {}
        for effect, of in zip(found, seen, strict=True):
            family = effect.candidate.family
            smallest_p[family] = min(of.p_value, smallest_p.get(family, 1.0))
        return [self._of(effect, of, together, smallest_p) for effect, of in zip(found, seen, strict=True)]

    def _residual(self, rows: ScoredRows, found: Sequence[SelectedEffect]) -> np.ndarray:
        return residual_of(self.simulation, rows, found)

    def _of(
        self,
        effect: SelectedEffect,
        seen: Seen,
        together: Mapping[str, float],
        smallest_p: Mapping[str, float],
    ) -> Confirmed:
        candidate = effect.candidate
        share, bound, p_value, largest_p, sizes, is_local = seen
        is_confirmed = bound > self.config.smallest_improvement
        is_pooled = together.get(candidate.family, -np.inf) > bound
        if is_pooled:
            # One cause is confirmed on its joints together, and left off those on which it is no help.
            bound = together[candidate.family]
            is_confirmed = bound > self.config.smallest_improvement and share > 0.0
            if smallest_p[candidate.family] < largest_p:
                # The cause was found in the whole catalogue; whether a joint has part in it is asked of joints alone.
                p_value *= min(self.n_joint / self.n_hypotheses, 1.0)
        if candidate.deviation is not None:
            # Seen at the stops; speeds, which may hardly depend on the place, must not speak against it.
            p_value = float(min(1.0, ndtr(-self.encoders[candidate.joint].z) * self.n_joint))
            is_confirmed, sizes = share > -ENCODER_LOSS, ()
        is_confirmed = is_confirmed and p_value < largest_p and agree(sizes, self.config.largest_disagreement)
        return Confirmed(share, bound, p_value, is_confirmed, is_pooled, sizes, is_local and not is_pooled)

    def _beside_others(
        self, effect: SelectedEffect, found: Sequence[SelectedEffect], with_all: tuple[np.ndarray, np.ndarray]
    ) -> Seen:
        joint = effect.candidate.joint
        others = [f for f in found if f is not effect]
        known = ~self._may_set_in(effect)
        without = known * self._residual(self.held_out, others)[:, joint]
        after = known * with_all[0][:, joint]
        share, bound = self._bounded(without, after)
        is_local = False
        if share > self.config.smallest_improvement >= bound:
            there = self._bounded_where_it_acts(without, after, len(found))
            bound, is_local = max(bound, there), there > bound
        fitted_without = self._residual(self.fitted, others)
        change = fitted_without[:, joint] - with_all[1][:, joint]
        sizes = self._sizes((change, fitted_without[:, joint]), (without - after, without))
        scale = np.sqrt(self.fitted.floor)
        if explains_other_joints(change, fitted_without / scale, with_all[1] / scale, joint):
            return Seen(share, bound, 1.0, self.config.largest_p, sizes, is_local)
        acting = np.flatnonzero(change)  # what sets in mid-way is compared with itself, not with nothing
        since = acting[0] if len(acting) else 0
        if can_be_shifted(change[since:]):
            p_value = placebo_p(fitted_without[since:, joint], change[since:], self.n_hypotheses, self.seed)
            return Seen(share, bound, p_value, self.config.largest_p, sizes, is_local)
        folds = self.held_out.folds
        by_block = np.bincount(folds.block, without**2 - after**2, minlength=folds.n_blocks)
        return Seen(share, bound, rank_p(by_block, len(found)), self.config.largest_rank_p, sizes, is_local)

    def _sizes(
        self, on_fitted: tuple[np.ndarray, np.ndarray], on_held_out: tuple[np.ndarray, np.ndarray]
    ) -> list[Size]:
        """In each log, by all its rows: of either part the change by the effect, and the residual without it."""
        change, without = (np.concatenate(of) for of in zip(on_fitted, on_held_out, strict=True))
        parts = self.fitted, self.held_out
        log = [averaged(_index_of_log(rows.is_used), rows.is_used) for rows in parts]
        blocks = [self.fitted.folds.block, self.held_out.folds.block + self.fitted.folds.n_blocks]
        return sizes_by_log(change, without, np.concatenate(log), np.concatenate(blocks))

    def _bounded(
        self, before: np.ndarray, after: np.ndarray, only: np.ndarray | None = None
    ) -> tuple[float, float]:
        config = self.config
        return lower_bound(before, after, self.held_out, config.resamples, config.confidence, self.seed, only)

    def _bounded_where_it_acts(self, before: np.ndarray, after: np.ndarray, n_found: int) -> float:
        """Of what is rarely met: the bound over the blocks that show it, if it beats placebos on these rows, too."""
        if placebo_p(before, before - after, n_found, self.seed) >= self.config.largest_p:
            return -np.inf
        return self._bounded(before, after, where_it_acts(before, after, self.held_out))[1]

    def _supply(self, found: Sequence[SelectedEffect], without: WithoutSupply) -> dict[Key, Seen]:
        """A common change of speed, per joint, averaged over the time that the rows for fitting chose."""
        if not without:
            return {}
        active, widths_s = hypothesis_of(self.simulation, found), _widths_s(found)
        parts = [self._since(found, rows)[0] for rows in (self.fitted, self.held_out)]
        p_value = supply_p(self.simulation, active, parts, widths_s, self.seed)
        corrected, largest_p = min(p_value * self.n_hypotheses, 1.0), self.config.largest_p
        return {
            (SUPPLY, joint, None): Seen(*self._bounded(*of_joint), corrected, largest_p)
            for joint, of_joint in without.items()
        }

    def _without_common_change(self, found: Sequence[SelectedEffect]) -> WithoutSupply:
        """Confirmation rows' residuals per joint that has a common change of speed, with it and with it taken off."""
        widths_s = _widths_s(found)
        if not widths_s:
            return {}
        active = hypothesis_of(self.simulation, found)
        since, kept = self._since(found, self.held_out)
        by_joint = without_common_change(self.simulation, active, since, widths_s)
        result, supply = {}, next(f for f in found if f.candidate.family == SUPPLY)
        counting = kept & ~self._may_set_in(supply)
        for joint, of_joint in by_joint.items():
            before, after = np.zeros((2, len(kept)))
            before[kept], after[kept] = of_joint
            result[joint] = before, after, counting
        return result

    def _since(self, found: Sequence[SelectedEffect], rows: ScoredRows) -> tuple[ScoredRows, np.ndarray]:
        """The rows in which a common change of speed acts, all if there are none; and which they are, (N,)."""
        onset = next((f.candidate.onset for f in found if f.candidate.family == SUPPLY), None)
        if onset is not None:
            since, kept = rows_since(self.simulation, rows, onset)
            if kept.any():
                return since, kept
        return rows, np.ones(len(rows.folds.fold), bool)

    def _courses(self, found: Sequence[SelectedEffect]) -> dict[Key, Seen]:
        """Joints' own courses in time, of which the rows for fitting tell between others, too."""
        judged: dict[Key, Seen] = {}
        active, folds = hypothesis_of(self.simulation, found), self.held_out.folds
        for joint, shape in _points(found, COURSE).items():
            before, after = beyond_constants(
                self.simulation, active, self.held_out, self.fitted, joint, shape
            )
            by_block = np.bincount(folds.block, before**2 - after**2, minlength=folds.n_blocks)
            p_value = rank_p(by_block, len(found))
            share, bound = self._bounded(before, after)
            judged[COURSE, joint, None] = Seen(share, bound, p_value, self.config.largest_rank_p)
        return judged

    def _may_set_in(self, found: SelectedEffect) -> np.ndarray:
        """(N,) confirmation rows of which the rows for fitting cannot say whether the effect has set in by then."""
        between = found.candidate.onset_between
        if between is None:
            return np.zeros(len(self.held_out.folds.fold), bool)
        stamps = self.simulation.sequences.stamp_ns
        is_between = (stamps >= between[0]) & (stamps < between[1])
        return averaged(is_between.astype(float), self.held_out.is_used) > 0.0

    def _together(
        self, found: Sequence[SelectedEffect], everything: np.ndarray, without_supply: WithoutSupply
    ) -> dict[str, float]:
        """Lower bound of what a cause removes on all its joints together, for causes that several joints have."""
        bounds = {}
        for family in of_one_cause([f.candidate for f in found], self.excited):
            members = [f for f in found if f.candidate.family == family]
            joints = sorted({f.candidate.joint for f in members})
            if family == SUPPLY:
                without, after = (
                    np.stack([without_supply[joint][part] for joint in joints], axis=1) for part in (0, 1)
                )
                only = without_supply[joints[0]][2]
            else:
                only = None
                without = self._residual(self.held_out, [f for f in found if f not in members])[:, joints]
                after = everything[:, joints]
            known = ~np.any([self._may_set_in(member) for member in members], axis=0)
            bounds[family] = self._bounded_together(
                known[:, None] * without, known[:, None] * after, joints, only
            )
        return bounds

    def _bounded_together(
        self, before: np.ndarray, after: np.ndarray, joints: Sequence[int], only: np.ndarray | None
    ) -> float:
        """The bound for several joints' residuals (N, k), each in units of what it is before, or of its floor."""
        counted = before if only is None else before[only]
        scale = np.maximum(np.mean(counted**2, axis=0), self.held_out.floor[list(joints)])
        every = range(len(joints))
        return self._bounded(pooled(before, every, scale), pooled(after, every, scale), only)[1]


def _index_of_log(is_used: np.ndarray) -> np.ndarray:
    """(B, T) 0, 1, ... B - 1."""
    return np.broadcast_to(np.arange(float(len(is_used)))[:, None], is_used.shape)


def _points(found: Sequence[SelectedEffect], family: str) -> dict[int, Mapping[str, float]]:
    """Per joint, over which times an effect without a wrapper is averaged."""
    return {f.candidate.joint: f.candidate.point for f in found if f.candidate.family == family}


def _widths_s(found: Sequence[SelectedEffect]) -> dict[int, float]:
    return {joint: point["width"] for joint, point in _points(found, SUPPLY).items()}


def in_words(effect: SelectedEffect, judgement: Confirmed, joint: str) -> str:
    """The judgement as a sentence."""
    of_what = (
        "with its other joints " if judgement.is_pooled else "where it acts " if judgement.is_local else ""
    )
    least = f"{of_what}at least {judgement.bound:.0%}"
    in_logs = ", ".join(f"{size.value:.0%}" for size in judgement.sizes)
    return (
        f"{effect.candidate.family} on {joint} is {'' if judgement.is_confirmed else 'not '}confirmed: on confirmation "
        f"rows it removes {judgement.share:.0%} of the squared residual ({least}); p = {judgement.p_value:.1g} against "
        f"placebos" + (f"; in single logs it is {in_logs} of its size." if in_logs else ".")
    )
