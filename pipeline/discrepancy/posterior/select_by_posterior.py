"""Step 3 by the posterior: the most probable explanation, with what the logs cannot tell from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.families.plausibility import DELAY, TIMING
from pipeline.discrepancy.families.uncorrectable import screen_without_wrapper
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.posterior.evidence.joint_evidence import ONSET_STEP_S, JointEvidence
from pipeline.discrepancy.posterior.evidence.nominal_joint import Rows
from pipeline.discrepancy.posterior.explanations import Cause, Explanation, Posterior
from pipeline.discrepancy.posterior.findings import Finding, findings_of, rivals_of
from pipeline.discrepancy.posterior.residual.columns import columns_of
from pipeline.discrepancy.posterior.residual.rows import facts_of
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.refine import completed, refine, with_gains
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.select import Selection, encoders_on
from pipeline.discrepancy.selection.selected_effect import SelectedEffect

CREDIBLE = 0.95  # of all probability holds what is told: an effect and its equivalents
TOLD = 3  # explanations in the log


@dataclass(frozen=True)
class PosteriorSelection(Selection):
    """The most probable explanation.

    Attributes:
        explanations: All that were weighed, most probable first.
        joints: Their evidence on the rows for fitting and selection.
        chosen: The most probable one that has an effect.
        findings: Its effects; `found` has their numbers as its causes.
    """

    explanations: Sequence[Explanation]
    joints: Sequence[JointEvidence]
    chosen: Explanation
    findings: Sequence[Finding]


def select_by_posterior(diagnosis: Diagnosis, journal: Journal) -> PosteriorSelection:
    """Weigh sets of effects against each other on the rows for fitting and selection."""
    nominal, logs, simulation, rows = diagnosis.nominal, diagnosis.logs, diagnosis.simulation, diagnosis.rows
    excluded = logs.config.exclude
    of_nominal = rows_with_columns(diagnosis, nominal.simulation, nominal.rows)
    of_measured = rows_with_columns(diagnosis, simulation, rows, logs.label)
    joints = [
        JointEvidence(joint, of_nominal, of_measured, nominal.present) for joint in range(len(logs.joints))
    ]
    families = [family for family in simulation.effects if family not in excluded]
    explanations = Posterior(joints, families, excluded).explanations()
    journal.end_part("posterior")
    for of in explanations[:TOLD]:
        journal.log(f"probability {of.probability:.3f}: {_in_words(of, logs.joints)}.")
    screened = screen(simulation, NOMINAL, rows, excluded, nominal=nominal.null)
    without_wrapper = screen_without_wrapper(simulation, NOMINAL, rows, excluded, nominal.null)
    # Whether there is any effect, all rows decide later.
    best = next((of for of in explanations if of.causes), explanations[0])
    findings, found = findings_of(best.causes), []
    for number, finding in enumerate(findings):
        rivals = rivals_of(finding, explanations, CREDIBLE)
        for cause in finding.causes:
            for joint, candidate in _candidates(cause, best, joints, without_wrapper).items():
                equivalents = _equivalents(finding, joint, rivals, joints)
                effect = SelectedEffect(
                    completed(simulation, candidate, nominal.present),
                    equivalents,
                    cause=(number, finding.family),
                )
                found.append(effect)
    found = with_gains(simulation, rows, refine(simulation, rows, found))
    journal.end_part("search on measured logs")
    comparison = Comparison(rows.folds, logs.config.search, tuple(nominal.at_rest.tolist()))
    ranked = sorted([*screened, *without_wrapper], key=comparison.net, reverse=True)
    encoders = encoders_on(diagnosis)
    return PosteriorSelection(found, ranked, comparison, encoders, explanations, joints, best, findings)


def rows_with_columns(
    diagnosis: Diagnosis, simulation: Simulation, rows: ScoredRows, purpose: np.ndarray | None = None
) -> Rows:
    """What the posterior has to know of rows.

    Args:
        diagnosis: That they are of.
        simulation: On their logs.
        rows: In use.
        purpose: (B, T) of measured rows.
    """
    velocity = rows.averaged(simulation.velocities([NOMINAL])[0])
    scale = diagnosis.nominal.setting.speed_scale
    facts = facts_of(simulation.sequences, rows, velocity, scale, purpose)
    columns = columns_of(simulation, rows, diagnosis.logs.config.exclude)
    # Nominal rows are predicted by the members that did not see them, one each.
    is_nominal = simulation is diagnosis.nominal.simulation
    members = [] if is_nominal else range(simulation.n_members)
    spread = np.zeros((*velocity.shape, simulation.n_members))
    for member in members:
        by_member = rows.averaged(simulation.by_member(member).velocities([NOMINAL])[0])
        spread[..., member] = rows.weight * (by_member - velocity)
    return Rows(columns, facts, velocity, rows.weight, spread)


def _candidates(
    cause: Cause,
    explanation: Explanation,
    joints: Sequence[JointEvidence],
    without_wrapper: Sequence[Candidate],
) -> Mapping[int, Candidate]:
    """By joint, with the coefficients that are most probable in the explanation."""
    if not cause.terms:
        of_family = {c.joint: c for c in without_wrapper if c.family == cause.family}
        return {joint: of_family[joint] for joint in cause.joints if joint in of_family}
    return {joint: _candidate(joints[joint], index, explanation) for joint, index in cause.terms.items()}


def _candidate(evidence: JointEvidence, index: int, explanation: Explanation) -> Candidate:
    """A term with the coefficients that are most probable in an explanation."""
    of_joint = [cause.terms[evidence.joint] for cause in explanation.causes if evidence.joint in cause.terms]
    columns, found = evidence.prior(sorted(of_joint)).columns, evidence.fit(of_joint).coefficients
    values = dict(zip(columns, found, strict=True))
    term, onset = evidence.terms[index], evidence.onsets[index]
    coefficients = np.array([values[column] for column in term.columns] if term.freed else [])
    if term.freed:
        coefficients = np.clip(coefficients, term.lower, term.upper)
    around = int(ONSET_STEP_S * 1e9)
    return Candidate(
        _told(term.family),
        term.joint,
        term.source,
        term.point,
        term.freed,
        coefficients,
        gain=0.0,
        share=0.0,
        gain_by_block=np.zeros(0),
        onset=onset,
        onset_between=None if onset is None else (onset - around, onset + around),
    )


def _equivalents(
    finding: Finding,
    joint: int,
    rivals: Sequence[tuple[Finding, Explanation, float]],
    joints: Sequence[JointEvidence],
) -> list[Candidate]:
    """What may stand in the place of a finding on a joint, most probable first."""
    result: dict[str, Candidate] = {}
    for rival, explanation, _ in rivals:
        for cause in rival.causes:
            index = cause.terms.get(joint)
            if index is not None and _told(cause.family) != _told(finding.causes[0].family):
                result.setdefault(_told(cause.family), _candidate(joints[joint], index, explanation))
    return list(result.values())


def _told(family: str) -> str:
    """As what it is told on a joint: equal delays of all joints become a late channel later."""
    return DELAY if family == TIMING else family


def _in_words(explanation: Explanation, joints: Sequence[str]) -> str:
    if not explanation.causes:
        return "no effect"
    return " and ".join(
        f"{cause.family}{' that sets in' if cause.sets_in else ''} on {', '.join(joints[j] for j in cause.joints)}"
        for cause in explanation.causes
    )
