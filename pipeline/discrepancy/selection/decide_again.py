"""A second decision between effects that could not be told apart while what is beside them was unknown."""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import is_dependence
from pipeline.discrepancy.families.whole_machine import OF_ONE_CAUSE
from pipeline.discrepancy.selection.comparison import NEGLIGIBLE
from pipeline.discrepancy.selection.refine import refine
from pipeline.discrepancy.selection.regression import t_statistic
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of


def decide_again(
    simulation: Simulation,
    rows: ScoredRows,
    found: list[SelectedEffect],
    equivalent_t: float,
    log: Callable[[str], None],
) -> list[SelectedEffect]:
    """Fit each named equivalent in the place of its effect; keep the best, and those that are still as good.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: All effects.
        equivalent_t: An effect is worse only if the difference is so many standard errors.
        log: Called with a sentence per change of mind.
    """
    for place in range(len(found)):
        first = found[place]
        joint = first.candidate.joint
        beside = {f.candidate.family for f in found if f is not first and f.candidate.joint == joint}
        # what several joints have in common is no matter of one of them
        known = beside.union(OF_ONE_CAUSE)
        named = [c for c in first.equivalents if not is_dependence(c) and c.family not in known]
        if not named or not beside or first.candidate.family in OF_ONE_CAUSE:
            continue
        trials = [found]
        for option in named:
            trials.append(
                refine(simulation, rows, [*found[:place], SelectedEffect(option), *found[place + 1 :]])
            )
        squares = [_squares_by_block(simulation, rows, trial, joint) for trial in trials]
        best = squares[int(np.argmin([of_trial.sum() for of_trial in squares]))]
        even = [
            t_statistic(of_trial - best) <= equivalent_t
            or (of_trial - best).sum() <= NEGLIGIBLE * first.candidate.gain
            for of_trial in squares
        ]
        chosen = even.index(True)  # the simplest comes first, and the best is even with itself
        found = trials[chosen]
        rest = [trial[place].candidate for trial, is_even in zip(trials, even, strict=True) if is_even]
        others = [c for c in first.equivalents if not any(c is option for option in named)]
        candidate = found[place].candidate
        if chosen:
            log(f"beside the others {candidate.family} explains better what {first.candidate.family} did")
        found = [
            *found[:place],
            SelectedEffect(candidate, [*(c for c in rest if c is not candidate), *others], first.losers),
            *found[place + 1 :],
        ]
    return found


def _squares_by_block(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect], joint: int
) -> np.ndarray:
    """(n_blocks,) squared residual of a joint, in units of its noise floor."""
    residual = residual_of(simulation, rows, found)[:, joint]
    return np.bincount(rows.folds.block, residual**2, minlength=rows.folds.n_blocks) / rows.floor[joint]
