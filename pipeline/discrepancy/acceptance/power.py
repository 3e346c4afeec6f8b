"""Power: from which size on an effect would have been found with 90 %, family by family and joint by joint.

An effect of size s adds s x to the residual. What logs tell of s scatters by σ: that is the root mean square of what
parts of the nominal logs ask for, which are without it. So s is found with 90 % where s − 1.28 σ passes the test of
the search, and is more than nominal logs ask for. Tests of confirmation rows are not counted.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.size_of_an_effect import LARGEST_BY_CHANCE, asked_for
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.families.plausibility import DELAY, TIMING
from pipeline.discrepancy.posterior.residual.columns import Term, columns_of
from pipeline.discrepancy.selection.candidate import Candidate, scored
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.grouping import OTHER, told_as
from pipeline.discrepancy.selection.regression import evidence
from pipeline.discrepancy.selection.selected_effect import residual_of
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Parameter

FOUND_WITH = 0.9
HALVINGS = 10  # of the span of plausible sizes: to a thousandth of it


class Visible(NamedTuple):
    """Of a family on a joint.

    Attributes:
        family: Name.
        joint: Index.
        size: Of its first parameter, how far from neutral; infinite where no plausible size would have been found.
        unit: Of that parameter, as on its card.
    """

    family: str
    joint: int
    size: float
    unit: str


def visible_sizes(fit: FittedEffects) -> list[Visible]:
    """Of every family with an equation on every joint, beside the effects that were found."""
    diagnosis = fit.diagnosis
    logs, nominal, rows = diagnosis.logs, diagnosis.nominal, diagnosis.rows
    measured = columns_of(diagnosis.simulation, rows, logs.config.exclude)
    without = columns_of(nominal.simulation, nominal.rows, logs.config.exclude)
    residual = residual_of(diagnosis.simulation, rows, fit.found)
    comparison = Comparison(rows.folds, logs.config.search, tuple(nominal.at_rest))
    passes = partial(comparison.passes, is_further=bool(fit.found))
    sizes: dict[tuple[str, int], float] = {}
    for term in (term for term in measured.terms if told_as(term.family) != OTHER):
        joint, key = term.joint, (term.family, term.joint)
        sizes.setdefault(key, np.inf)
        columns, size_of_one, most = _first_parameter(term)
        if not columns or joint not in diagnosis.excited:
            continue
        change, on_nominal = (
            of.matrices[joint][:, columns].sum(axis=1, keepdims=True, dtype=float)
            for of in (measured, without)
        )
        asked = asked_for(on_nominal, without.residual[:, [joint]], nominal.rows.floor[[joint]])
        scatter = 0.0 if logs.is_of_one_machine else asked.share
        owed = nominal.null[*key, None].most_per_row * len(change) if (*key, None) in nominal.null else 0.0
        changed = change[:, 0]
        rest = residual[:, joint] - changed * (changed @ residual[:, joint] / max(changed @ changed, 1e-12))
        present = partial(with_effect, term, changed, rest, rows, owed)
        sizes[key] = min(sizes[key], size_of_one * _smallest(present, passes, scatter, most))
    return [Visible(*key, size, _first(key[0]).unit) for key, size in sizes.items()]


def _first(family: str) -> Parameter:
    return KNOWN[DELAY if family == TIMING else family].card.parameters[0]


def _first_parameter(term: Term) -> tuple[list[int], float, float]:
    """Columns of a family's first parameter, the size that a coefficient of one is, and the largest coefficient.

    There are no columns where the term has other parameters alone.
    """
    first = _first(term.family)
    if not term.freed:
        size = abs(term.point.get(first.name, first.neutral) - first.neutral)
        return list(term.columns) if size else [], size / term.mean[0], term.mean[0]
    of_first = [i for i, one in enumerate(term.freed) if first.name in {name for name, _ in one}]
    most = max((max(-term.lower[i], term.upper[i]) for i in of_first), default=0.0)
    return [term.columns[i] for i in of_first], 1.0, most


def with_effect(
    term: Term, change: np.ndarray, rest: np.ndarray, rows: ScoredRows, owed: float, size: float
) -> Candidate:
    """What a term would explain of these rows, had it a size beside all that they show.

    Args:
        term: A family on a joint.
        change: (N,) by a size of one.
        rest: (N,) residual without what looks like the effect.
        rows: The rows.
        owed: Of the gain, to the model's misfit.
        size: Of the effect.
    """
    measured, nothing = rest + size * change, np.zeros(0)
    explained = evidence(measured, rest, np.zeros((len(rest), 0)), rows.folds, nothing, nothing)
    candidate = scored(
        explained, measured, rows.floor[term.joint], term.family, term.joint, None, term.point, ()
    )
    return replace(candidate, owed=owed)


def _smallest(
    present: Callable[[float], Candidate], passes: Callable[[Candidate], bool], scatter: float, most: float
) -> float:
    """The least size that is found with 90 %; infinite where it is larger than `most`."""
    beside = norm.ppf(FOUND_WITH) * scatter
    least, largest = LARGEST_BY_CHANCE * scatter, most - beside
    if largest < least or not passes(present(largest)):
        return np.inf
    if passes(present(least)):
        return float(least + beside)
    for _ in range(HALVINGS):
        middle = 0.5 * (least + largest)
        least, largest = (least, middle) if passes(present(middle)) else (middle, largest)
    return float(largest + beside)
