"""How far confirmation rows, which no fit saw, bear out an effect: e-values against its not being there.

Confirmation rows ask for a size of the effect as it was fitted. Nominal logs, which are without it, ask for sizes about
zero. Divided by the root mean square of these over k parts, a size has Student's t distribution with k degrees of
freedom, if the effect is not there.
"""

from collections.abc import Mapping

import numpy as np
from scipy.stats import t

from pipeline.discrepancy.acceptance.confirmation import Confirmed
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS
from pipeline.discrepancy.acceptance.size_of_an_effect import asked_for_on_nominal, to_put_on_nominal
from pipeline.discrepancy.selection.candidate import Key
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

SMALLEST_P = 1e-300  # whose e-value can be held


def e_values(fit: FittedEffects, judgements: Mapping[Key, Confirmed]) -> dict[Key, float]:
    """Of each effect of the machine, by its members' keys.

    Where nominal logs cannot be asked, it is that of the effect's own test.
    """
    result: dict[Key, float] = {}
    for effect in fit.effects:
        members = to_put_on_nominal(fit.diagnosis, effect)
        if members:
            p_value = p_on_confirmation_rows(fit, effect, members)
        else:
            p_value = min(judgements[member.candidate.key].p_value for member in effect.members)
        result |= {member.candidate.key: e_value_of(p_value) for member in effect.members}
    return result


def p_on_confirmation_rows(fit: FittedEffects, effect: MachineEffect, members: list[SelectedEffect]) -> float:
    """How probable so large a size is on confirmation rows, were the effect not there."""
    simulation, rows = fit.diagnosis.simulation, fit.diagnosis.held_out
    residual = residual_of(simulation, rows, [f for f in fit.found if f not in effect.members])
    change = residual - residual_of(simulation, rows, fit.found)
    squares = np.sum(change**2 / rows.floor)
    size = np.sum(change * residual / rows.floor) / max(squares, 1e-12)
    nominal = asked_for_on_nominal(fit.diagnosis.nominal, members)
    # Rows that show less of it scatter more; those that show more scatter no less, as misfit is no noise.
    scatter = nominal.share * np.sqrt(max(nominal.squares / max(squares, 1e-12), 1.0))
    return float(t.sf(size / max(scatter, 1e-12), MISFIT_PARTS))


def e_value_of(p_value: float) -> float:
    """The mean of κ p^(κ − 1) over κ in (0, 1), whose expectation is one at most where there is no effect.

    Source: Vovk and Wang (2021), E-values: calibration, combination and applications, Annals of Statistics 49.
    """
    if p_value >= 1.0:
        return 0.5
    p = max(p_value, SMALLEST_P)
    return float((1.0 - p + p * np.log(p)) / (p * np.log(p) ** 2))


def as_told(e_value: float) -> dict[str, float]:
    """As in closed_loop.json, with the p-value that it is (contract, section 4)."""
    return {"e_value": e_value, "p_value": min(1.0, 1.0 / e_value)}
