"""Whether known effects are still there, asked at the end of a search, beside all that is new."""

import enum
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.selection.regression import SURE_T, t_statistic
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of


class Left(enum.Enum):
    """What became of a known effect."""

    there = enum.auto()
    gone = enum.auto()
    unseen = enum.auto()


def what_is_left(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    effect: SelectedEffect,
    does_something: Callable[[SelectedEffect], bool],
) -> Left:
    """What became of one of the effects found, on a joint that moves enough to tell.

    There it is if it takes squares off beside the others. Gone it is if the joint moves as if it had none, rather than
    one as it was: that it shows no more is not enough.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: All effects.
        effect: The known one.
        does_something: Whether an effect takes enough off the squares, and not by chance.
    """
    if does_something(effect):
        return Left.there
    others, joint = [f for f in found if f is not effect], effect.candidate.joint
    without, as_before = (
        residual_of(simulation, rows, of)[:, joint] ** 2 for of in (others, [*others, as_it_was(effect)])
    )
    worse = np.bincount(rows.folds.block, as_before - without, minlength=rows.folds.n_blocks)
    return Left.gone if worse.sum() > 0.0 and t_statistic(worse) >= SURE_T else Left.unseen


def as_it_was(effect: SelectedEffect) -> SelectedEffect:
    """A known effect with the values that it had, of which the present logs say nothing."""
    assert effect.known is not None
    was = effect.known.candidate
    candidate = replace(effect.candidate, point=was.point, freed=was.freed, coefficients=was.coefficients)
    return replace(effect, candidate=candidate, known=replace(effect.known, is_seen=False))
