"""Effects that set in at some moment: the search for the moment (Page, 1954; one change, by least squares).

Before the onset the residual is that without the effect, after it that with the effect; the best moment has the
smallest sum of squares over both. Coefficients are fitted again on the rows after it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate, Nominal, with_candidate
from pipeline.discrepancy.selection.refine import refine
from pipeline.discrepancy.selection.regression import SURE_T, Folds, t_statistic
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import DEPENDENCES

TRIED_PER_JOINT = 4  # named families, by gain
SMALLEST_PART = 0.08  # of the squared velocity: less before or after the moment tells nothing
SMALLEST_GAIN = 1.2  # of the gain without onset
FEWEST_BLOCKS = 3  # before the onset, to tell
AS_GOOD = 20.0  # squares of the noise floor: some ten independent rows at one standard deviation
ITERATIONS = 3
WHOLE = 0.999


def with_onsets(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    candidates: Sequence[Candidate],
    known: Sequence[int] = (),
) -> list[Candidate]:
    """The candidates; each of the best per joint is replaced by itself with an onset, where that is clearly better.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows in use.
        candidates: Any number.
        known: Moments, absolute stamps in ns, at which something else set in: preferred where as good.
    """
    result = []
    count: dict[int, int] = {}
    for candidate in sorted(candidates, key=lambda c: -c.gain):
        count.setdefault(candidate.joint, 0)
        if _can_set_in(candidate) and candidate.share > 0.02 and count[candidate.joint] < TRIED_PER_JOINT:
            count[candidate.joint] += 1
            candidate = _with_onset(simulation, active, rows, candidate, known)
        result.append(candidate)
    return result


def since(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    first: Candidate,
    excluded: Sequence[str],
    nominal: Nominal,
) -> list[Candidate]:
    """Every candidate, acting from the moment on at which `first` sets in, fitted on the rows after it.

    What is fitted on rows before the moment, too, can fail for any effect but one that is linear in a single value.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows in use.
        first: What is known to set in.
        excluded: Families that are not tried.
        nominal: What explains something of nominal logs.
    """
    if first.onset is None:
        return []
    after, _ = rows_since(simulation, rows, first.onset)
    squares = _squares(simulation, active, rows)
    return [
        replace(
            c,
            onset=first.onset,
            onset_between=first.onset_between,
            share=c.gain * rows.floor[c.joint] / squares[c.joint],
        )
        for c in screen(simulation, active, after, excluded, nominal=nominal)
        if _can_set_in(c) or c.family in DEPENDENCES
    ]


def rows_since(simulation: Simulation, rows: ScoredRows, moment: int) -> tuple[ScoredRows, np.ndarray]:
    """The rows from a moment on, in the same blocks and in folds of their own.

    Args:
        simulation: On the logs.
        rows: Rows in use.
        moment: Absolute stamp, ns.

    Returns:
        Those rows; and which of all rows in use they are, (N,).
    """
    is_after = simulation.sequences.stamp_ns >= moment
    kept = rows.averaged(is_after.astype(float)) > WHOLE
    folds = Folds(rows.folds.block[kept] % 2, rows.folds.block[kept], rows.folds.n_blocks)
    return ScoredRows(rows.is_used & is_after, folds, rows.floor, rows.weight[kept]), kept


def of_one_moment(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect], families: Sequence[str]
) -> list[SelectedEffect]:
    """Effects of which those of one cause, on several joints, all set in at the moment that suits them best.

    On a joint on which little of it shows, its moment does not.

    Args:
        simulation: On the logs.
        rows: Rows in use.
        found: Effects, fitted.
        families: Whose effects on several joints are one cause.
    """
    found = list(found)
    for family in families:
        members = [
            i for i, f in enumerate(found) if f.candidate.family == family and has_wrapper(f.candidate)
        ]
        moments = {found[i].candidate.onset: found[i].candidate.onset_between for i in members}
        if len(moments) < 2:
            continue
        joints = [found[i].candidate.joint for i in members]
        trials = []
        for onset, between in moments.items():
            trial = list(found)
            for i in members:
                candidate = replace(found[i].candidate, onset=onset, onset_between=between)
                trial[i] = replace(found[i], candidate=candidate)
            trial = refine(simulation, rows, trial)
            left = residual_of(simulation, rows, trial)[:, joints]
            trials.append((float(np.sum(left**2 / rows.floor[joints])), trial))
        found = min(trials, key=lambda trial: trial[0])[1]
    return found


def _can_set_in(candidate: Candidate) -> bool:
    return candidate.family in KNOWN and KNOWN[candidate.family].card.can_set_in


def _squares(simulation: Simulation, active: Hypothesis, rows: ScoredRows) -> np.ndarray:
    """(n_joint,) sums of the squared residual."""
    velocity = simulation.velocities([active])[0]
    residual = rows.weight * rows.averaged(simulation.sequences.velocity - velocity)
    return np.maximum(np.sum(residual**2, axis=0), 1e-12)


def _with_onset(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, candidate: Candidate, known: Sequence[int]
) -> Candidate:
    joint, sequences, blocks = candidate.joint, simulation.sequences, rows.folds
    first = sequences.stamp_ns.min()
    stamps = rows.averaged(sequences.stamp_ns - first)
    order = np.argsort(rows.averaged(sequences.stamp_ns.astype(np.float64)), kind="stable")

    def left(velocity: np.ndarray) -> np.ndarray:
        return rows.weight[:, joint] * rows.averaged((sequences.velocity - velocity)[..., joint])

    velocity = simulation.velocities([active])[0]
    before = left(velocity)
    excited = np.cumsum(rows.averaged(velocity[..., joint])[order] ** 2)
    excited /= max(excited[-1], 1e-12)
    inside = np.flatnonzero((excited > SMALLEST_PART) & (excited < 1.0 - SMALLEST_PART))
    if len(inside) == 0:
        return candidate
    current, place = candidate, 0
    for _ in range(ITERATIONS):
        after = left(simulation.velocities([with_candidate(simulation, active, current)])[0])
        if current.freed:
            # The change is close to linear in its coefficients: scale it as the rows after the moment want it.
            change = before - after
            late = order[place:]
            scale = float(change[late] @ before[late] / max(change[late] @ change[late], 1e-12))
            scale = float(np.clip(scale, 0.2, 5.0))
            current = replace(current, coefficients=np.clip(current.coefficients * scale, -2.0, 2.0))
            after = before - scale * change
        removed = before**2 - after**2
        advantage = np.concatenate([[0.0], np.cumsum(removed[order])])
        total = advantage[-1] - advantage  # gain if it sets in at this place of the order
        place = int(inside[np.argmax(total[inside])])
    is_early = np.zeros(len(before), bool)
    is_early[order[:place]] = True
    gain_by_block = np.bincount(blocks.block, np.where(is_early, 0.0, removed), blocks.n_blocks)
    gain_by_block = gain_by_block / rows.floor[joint]
    gain = float(gain_by_block.sum())
    harm = np.bincount(blocks.block, np.where(is_early, -removed, 0.0), blocks.n_blocks)
    harm = harm[np.unique(blocks.block[is_early])]
    is_harm = len(harm) >= FEWEST_BLOCKS and t_statistic(harm) > SURE_T
    if gain < SMALLEST_GAIN * candidate.gain or not is_harm:
        return candidate
    # Where the joint stands, and where rows are kept for confirmation, one moment is as good as the other: the middle.
    as_good = inside[total[inside] > total[place] - AS_GOOD * rows.floor[joint]]
    moments = stamps[order[[max(as_good[0] - 1, 0), as_good[-1]]]]
    same = [moment for moment in known if moments[0] <= moment - first <= moments[1]]
    onset = same[0] if same else int(moments.mean() + first)
    share = gain * rows.floor[joint] / max(float(np.sum(before**2)), 1e-12)
    between = (int(first + moments[0]), int(first + moments[1]))
    return replace(
        current, gain=gain, share=share, gain_by_block=gain_by_block, onset=onset, onset_between=between
    )
