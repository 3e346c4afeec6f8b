"""Step 4: the confirmation rows are opened once, and only what they bear out stays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.discrepancy.acceptance.confirmation import Confirmed, confirm, in_words
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects, grouped, refitted
from pipeline.discrepancy.acceptance.power import Visible, visible_sizes
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.candidate import Key
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


@dataclass(frozen=True)
class Acceptance:
    """What confirmation rows say of the selection.

    Attributes:
        judgements: Of each effect that was selected.
        fit: Effects that passed.
        power: What these logs would have shown.
    """

    judgements: Mapping[Key, Confirmed]
    fit: FittedEffects
    power: Sequence[Visible]


def accept(diagnosis: Diagnosis, selection: Selection, journal: Journal) -> Acceptance:
    """Judge every effect beside all others; those with an equation that the given model has were judged before."""
    smallest, joints = diagnosis.logs.config.gate.smallest_e_value, diagnosis.logs.joints
    found = [replace(f, equivalents=[]) if f.known else f for f in selection.found]
    fit = grouped(diagnosis, found)
    judgements: dict[Key, Confirmed] = {}
    while True:
        now: dict[Key, Confirmed] = {}
        for effect in fit.effects:
            now |= confirm(fit, effect, selection.encoders, smallest)
        for f in fit.found:
            key = f.candidate.key
            is_new = key not in judgements or judgements[key].why_not != now[key].why_not
            if is_new and not is_given(f):
                journal.log(in_words(f, now[key], joints[f.candidate.joint]))
        judgements |= now
        passed = [f for f in fit.found if is_given(f) or now[f.candidate.key].why_not is None]
        if len(passed) == len(fit.found):
            break
        fit = refitted(diagnosis, passed)
    journal.end_part("gate")
    return Acceptance(judgements, fit, visible_sizes(fit))


def is_given(effect: SelectedEffect) -> bool:
    """Whether the given model has it, with an equation: an earlier run has borne it out."""
    return effect.known is not None and has_wrapper(effect.candidate)
