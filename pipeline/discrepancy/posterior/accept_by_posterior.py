"""Step 4 by the posterior: what is probable enough is told, with what confirmation rows say of it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.acceptance.accept import Acceptance
from pipeline.discrepancy.acceptance.confirmation import Confirmed
from pipeline.discrepancy.acceptance.fitted_effects import grouped, refitted
from pipeline.discrepancy.acceptance.power import Visible
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.posterior.e_values import e_value_of, log_e_value
from pipeline.discrepancy.posterior.explanations import LOG_MORE
from pipeline.discrepancy.posterior.findings import (
    Finding,
    probability_of,
    probability_of_none,
    rivals_of,
)
from pipeline.discrepancy.posterior.new_rows import on_all_rows
from pipeline.discrepancy.posterior.power import visible_sizes
from pipeline.discrepancy.posterior.select_by_posterior import CREDIBLE, PosteriorSelection, rows_with_columns
from pipeline.discrepancy.selection.grouping import OTHER, told_as
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

PROBABLE = 0.5  # of an effect that is told: more probable than not (Barbieri and Berger 2004, median probability model)


class Belief(NamedTuple):
    """In one finding.

    Attributes:
        probability: Of its name on its joints.
        rivals: Equivalent findings, with their probabilities.
        log_e: Natural logarithm of the name's e-value.
    """

    probability: float
    rivals: Sequence[tuple[Finding, float]]
    log_e: float

    @property
    def is_told(self) -> bool:
        """Whether the effect, by whichever of these names, is more probable than not."""
        return self.probability + sum(of for _, of in self.rivals) >= PROBABLE


def accept_by_posterior(diagnosis: Diagnosis, selection: PosteriorSelection, journal: Journal) -> Acceptance:
    """Tell what is probable on all rows, those for confirmation included."""
    fitted = selection.joints
    rows = rows_with_columns(diagnosis, diagnosis.simulation, diagnosis.held_out)
    held_out = [of.on(rows) for of in fitted]
    residual = residual_of(diagnosis.simulation, diagnosis.held_out, selection.found)
    explanations = on_all_rows(selection.explanations, fitted, held_out)
    of_none = probability_of_none(explanations)
    is_any = of_none <= diagnosis.logs.config.posterior.largest_none
    journal.log(f"On all rows, the probability of no effect is {of_none:.2g}.")
    beliefs = []
    for finding in selection.findings:
        rivals = [(rival, of) for rival, _, of in rivals_of(finding, explanations, CREDIBLE)]
        log_e = log_e_value(finding, selection.chosen, fitted, held_out, residual)
        beliefs.append(Belief(probability_of(finding, explanations), rivals, log_e))
        joints = ", ".join(diagnosis.logs.joints[joint] for joint in sorted(finding.joints))
        probability, e_value = beliefs[-1].probability, e_value_of(log_e)
        journal.log(f"{finding.family} on {joints}: probability {probability:.3f}; e-value {e_value:.2g}.")
    judgements = {}
    for effect in selection.found:
        assert effect.cause is not None
        belief = beliefs[effect.cause[0]]
        judgements[effect.candidate.key] = Confirmed(
            _share(diagnosis, selection, effect),
            belief.log_e,
            float(np.exp(-max(belief.log_e, 0.0))),
            is_any and belief.is_told,
            is_pooled=False,
            probability=belief.probability,
        )
    passed = [
        _with_rivals_left(f, beliefs[f.cause[0]])
        for f in selection.found
        if f.cause is not None and judgements[f.candidate.key].is_confirmed
    ]
    is_part = 0 < len(passed) < len(selection.found)
    fit = refitted(diagnosis, passed) if is_part else grouped(diagnosis, passed)
    journal.end_part("confirmation")
    of_rivals = {
        (rival.family, joint): of
        for belief in beliefs
        for rival, of in belief.rivals
        for joint in rival.joints
    }
    e_values = {key: e_value_of(judgement.bound) for key, judgement in judgements.items()}
    return Acceptance(
        judgements, fit, e_values, _power(diagnosis, selection), of_none, of_rivals, explanations
    )


def _with_rivals_left(effect: SelectedEffect, belief: Belief) -> SelectedEffect:
    """An effect with the equivalents that confirmation rows leave."""
    names = {rival.family for rival, _ in belief.rivals}
    return replace(effect, equivalents=[c for c in effect.equivalents if told_as(c.family) in names])


def _share(diagnosis: Diagnosis, selection: PosteriorSelection, effect: SelectedEffect) -> float:
    """Of the squares on confirmation rows that an effect removes beside the others."""
    without = [of for of in selection.found if of is not effect]
    before, after = (
        float(
            np.sum(residual_of(diagnosis.simulation, diagnosis.held_out, of)[:, effect.candidate.joint] ** 2)
        )
        for of in (without, selection.found)
    )
    return 1.0 - after / max(before, 1e-18)


def _power(diagnosis: Diagnosis, selection: PosteriorSelection) -> list[Visible]:
    families = [family for family in diagnosis.simulation.effects if told_as(family) != OTHER]
    largest = diagnosis.logs.config.posterior.largest_none
    n = len(selection.joints)
    log_prior = -np.log(len(diagnosis.simulation.effects)) - np.log(n) + LOG_MORE
    odds = float(np.log((1.0 - largest) / largest))
    return [of for joint in selection.joints for of in visible_sizes(joint, families, log_prior, odds)]
