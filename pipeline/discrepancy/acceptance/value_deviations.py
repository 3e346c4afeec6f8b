"""How far the values of wrappers may be off, in the shape that the wrappers take them in."""

from collections.abc import Mapping

import numpy as np

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.families.contract_parameters import UNKNOWN, spreads, within_plausible
from pipeline.discrepancy.selection.selected_effect import has_wrapper
from pipeline.effects.catalogue import KNOWN


def value_deviations(fit: FittedEffects) -> Mapping[str, Mapping[str, np.ndarray]]:
    """Standard deviations by family and parameter, (n_joint, ...); 0 where a value was not fitted."""
    diagnosis = fit.diagnosis
    deviations: dict[str, dict[str, np.ndarray]] = {}
    for number, member in enumerate(fit.found):
        candidate = member.candidate
        if not has_wrapper(candidate):
            continue
        coordinates, covariance = fit.covariance.get(candidate.joint, ([], np.zeros((0, 0))))
        model_error = diagnosis.logs.config.gate.model_error
        spread = spreads(coordinates, covariance, number, candidate, model_error)
        neutral = KNOWN[candidate.family](diagnosis.nominal.setting).neutral()
        of = deviations.setdefault(candidate.family, {name: np.zeros_like(v) for name, v in neutral.items()})
        for name in candidate.point:
            of[name][candidate.joint] = within_plausible(*spread.get(name, UNKNOWN))
        for index, freed in enumerate(candidate.freed):
            for name, source in freed:
                place = (candidate.joint, *([] if source is None else np.atleast_1d(source)))
                of[name][place] = within_plausible(*spread.get(f"coefficient:{index}", UNKNOWN))
    return deviations
