"""Power: from which size on an effect would have been found with 90 %, family by family and joint by joint.

An effect of size s adds s x to the residual. What logs tell of s scatters by σ, as on confirmation rows
(`confirmation.py`). So s is found with 90 % where s − 1.28 σ passes the search's test and has the smallest e-value.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from pipeline.discrepancy.acceptance.confirmation import are_without
from pipeline.discrepancy.acceptance.e_value import smallest_t
from pipeline.discrepancy.acceptance.first_parameters import Change, changes_of, tried
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.nominal_sizes import nominal_sizes
from pipeline.discrepancy.acceptance.shown import Deviation, Shown
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.families.plausibility import DELAY, TIMING
from pipeline.discrepancy.selection.candidate import Candidate, scored
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.regression import evidence
from pipeline.discrepancy.selection.selected_effect import residual_of
from pipeline.effects.catalogue import KNOWN

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
    without = residual_of(nominal.simulation, nominal.rows, [])
    residual = residual_of(diagnosis.simulation, rows, fit.found)
    comparison = Comparison(rows.folds, logs.config.search, tuple(nominal.at_rest))
    passes = partial(comparison.passes, is_further=bool(fit.found))
    families = tried(diagnosis.simulation, logs.config.exclude)
    sizes = {(family, joint): np.inf for family in families for joint in range(residual.shape[1])}
    for measured, on_nominal in zip(
        changes_of(diagnosis.simulation, rows, logs.config.exclude),
        changes_of(nominal.simulation, nominal.rows, logs.config.exclude),
        strict=True,
    ):
        joint, key = measured.joint, (measured.family, measured.joint)
        if joint not in diagnosis.excited:
            continue
        change = measured.of_one[:, None]
        beside = Shown(change, residual[:, [joint]])
        shown = Shown(change, beside.residual - beside.size * change)
        of_nominal = Shown(on_nominal.of_one[:, None], without[:, [joint]])
        usual, deviation = _usual(
            diagnosis, shown, of_nominal if are_without(diagnosis, measured.family) else None
        )
        owed = nominal.null[*key, None].most_per_row * len(change) if (*key, None) in nominal.null else 0.0
        present = partial(with_effect, measured, shown.residual[:, 0], rows, owed)
        least = usual + deviation.value * smallest_t(logs.config.gate.smallest_e_value, deviation.freedom)
        smallest = _smallest(present, passes, deviation.value, least, measured.most)
        sizes[key] = min(sizes[key], measured.size_of_one * smallest)
    if TIMING not in logs.config.exclude:
        sizes |= {(TIMING, joint): size for (family, joint), size in sizes.items() if family == DELAY}
    return [Visible(*key, size, KNOWN[key[0]].card.parameters[0].unit) for key, size in sizes.items()]


def _usual(diagnosis: Diagnosis, measured: Shown, nominal: Shown | None) -> tuple[float, Deviation]:
    """Size on confirmation rows where there is no effect, and the deviation from it; as of `confirmation.sizes`.

    Args:
        diagnosis: The logs.
        measured: An effect of size one on the rows for fitting, beside all that they show.
        nominal: The same effect on nominal logs; None: they have it.
    """
    rows = diagnosis.rows
    share = len(diagnosis.held_out.weight) / len(rows.weight)  # confirmation rows show as much per row
    of_fitted = measured.deviation_by_blocks(rows.folds.block)
    by_blocks = Deviation(of_fitted.value / np.sqrt(share), of_fitted.freedom * share)
    if nominal is None:
        return 0.0, by_blocks
    usual = nominal_sizes(nominal, nominal.squares / len(nominal.change))
    return usual.usual, by_blocks.and_of(usual.deviation_on(measured.squares * share))


def with_effect(change: Change, rest: np.ndarray, rows: ScoredRows, owed: float, size: float) -> Candidate:
    """What a family would explain of these rows on a joint, had it a size beside all that they show.

    Args:
        change: By a coefficient of one.
        rest: (N,) residual without what looks like the effect.
        rows: The rows.
        owed: Of the gain, to the model's misfit.
        size: The coefficient.
    """
    measured, nothing = rest + size * change.of_one, np.zeros(0)
    explained = evidence(measured, rest, np.zeros((len(rest), 0)), rows.folds, nothing, nothing)
    floor = rows.floor[change.joint]
    candidate = scored(explained, measured, floor, change.family, change.joint, None, change.point, ())
    return replace(candidate, owed=owed)


def _smallest(
    present: Callable[[float], Candidate],
    passes: Callable[[Candidate], bool],
    deviation: float,
    least: float,
    most: float,
) -> float:
    """The size that is found with 90 %: `least` or more; infinite where it is larger than `most`."""
    beside = norm.ppf(FOUND_WITH) * deviation
    largest = most - beside
    if largest < least or not passes(present(largest)):
        return np.inf
    if passes(present(least)):
        return float(least + beside)
    for _ in range(HALVINGS):
        middle = 0.5 * (least + largest)
        least, largest = (least, middle) if passes(present(middle)) else (middle, largest)
    return float(largest + beside)
