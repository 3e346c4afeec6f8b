"""Step 4: the confirmation rows are opened once, and only what they bear out stays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.discrepancy.acceptance.confirmation import Confirmation, Confirmed, in_words
from pipeline.discrepancy.acceptance.e_value import e_values
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects, grouped, refitted
from pipeline.discrepancy.acceptance.parameters import parameters_of
from pipeline.discrepancy.acceptance.power import Visible, visible_sizes
from pipeline.discrepancy.acceptance.size_of_an_effect import (
    asked_for_on_nominal,
    to_put_on_nominal,
    why_it_is_misfit,
    why_it_is_no_supply,
)
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.candidate import Key
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


@dataclass(frozen=True)
class Acceptance:
    """What confirmation rows say of the selection.

    Attributes:
        judgements: Of each effect that was selected.
        fit: Effects that passed.
        e_values: Of these, as effects of the machine.
        power: What these logs would have shown.
    """

    judgements: Mapping[Key, Confirmed]
    fit: FittedEffects
    e_values: Mapping[Key, float]
    power: Sequence[Visible]


def accept(diagnosis: Diagnosis, selection: Selection, journal: Journal) -> Acceptance:
    """Judge every effect beside all others; those with an equation that the given model has were judged before."""
    logs, found, screened = diagnosis.logs, selection.found, selection.screened
    confirmation = Confirmation(
        diagnosis.simulation,
        diagnosis.rows,
        diagnosis.held_out,
        selection.encoders,
        logs.config.gate,
        max(1, len(screened)),
        diagnosis.excited,
        len(logs.joints),
        logs.config.seed,
    )
    judgements = {f.candidate.key: of for f, of in zip(found, confirmation.judge(found), strict=True)}
    for effect in (f for f in found if not is_given(f)):
        joint = logs.joints[effect.candidate.joint]
        journal.log(in_words(effect, judgements[effect.candidate.key], joint))
    passed = [f for f in found if is_given(f) or judgements[f.candidate.key].is_confirmed]
    passed = [replace(f, equivalents=[]) if f.known else f for f in passed]
    is_part = 0 < len(passed) < len(found)
    fit = refitted(diagnosis, passed) if is_part else grouped(diagnosis, passed)
    fit = beyond_misfit(fit, journal.log)
    journal.end_part("gate")
    return Acceptance(judgements, fit, e_values(fit, judgements), visible_sizes(fit))


def is_given(effect: SelectedEffect) -> bool:
    """Whether the given model has it, with an equation: an earlier run has borne it out."""
    return effect.known is not None and has_wrapper(effect.candidate)


def beyond_misfit(fit: FittedEffects, log: Callable[[str], None]) -> FittedEffects:
    """Without what is no more than the diagnosis model is off by on nominal logs.

    Args:
        fit: Effects that confirmation rows bear out.
        log: Called with a sentence per effect that is dropped.
    """
    small = []
    for effect in (e for e in fit.effects if not e.is_known):
        why = _why_it_is_none(fit, effect)
        if why is not None:
            small.append(effect)
            log(f"{effect.family} is dropped: {why}.")
    if not small:
        return fit
    return refitted(fit.diagnosis, [member for e in fit.effects if e not in small for member in e.members])


def _why_it_is_none(fit: FittedEffects, effect: MachineEffect) -> str | None:
    if effect.family == SUPPLY:
        return why_it_is_no_supply(parameters_of(fit, effect)["correlation_time"], len(effect.joints))
    members = to_put_on_nominal(fit.diagnosis, effect)
    if not members:
        return None
    return why_it_is_misfit(asked_for_on_nominal(fit.diagnosis.nominal, members).share)
