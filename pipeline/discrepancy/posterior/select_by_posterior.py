"""Step 3 by the posterior: the most probable explanation, with what the logs cannot tell from it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.families.stops import encoders_of
from pipeline.discrepancy.families.uncorrectable import WITHOUT_WRAPPER, screen_without_wrapper
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.posterior.columns import DELAY, TIMING, columns_of
from pipeline.discrepancy.posterior.explanations import Cause, Explanation, Posterior
from pipeline.discrepancy.posterior.joint_evidence import ONSET_STEP_S, JointEvidence, Rows
from pipeline.discrepancy.posterior.rows import facts_of
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.refine import completed, refine
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

CREDIBLE = 0.95  # of all probability holds what is told: the most probable explanation and its equivalents
TOLD = 3  # explanations in the log


def select_by_posterior(diagnosis: Diagnosis, journal: Journal) -> Selection:
    """Weigh sets of effects against each other on the rows for fitting and selection."""
    nominal, logs, simulation, rows = diagnosis.nominal, diagnosis.logs, diagnosis.simulation, diagnosis.rows
    excluded = logs.config.exclude
    scale = nominal.setting.speed_scale
    of_nominal = _rows(nominal.simulation, nominal.rows, None, excluded, scale)
    of_measured = _rows(simulation, rows, logs.label, excluded, scale)
    joints = [
        JointEvidence(joint, of_nominal, of_measured, nominal.present) for joint in range(len(logs.joints))
    ]
    families = [family for family in simulation.effects if family not in excluded]
    explanations = Posterior(joints, families).explanations()
    journal.end_part("posterior")
    for of in explanations[:TOLD]:
        journal.log(f"probability {of.probability:.3f}: {_in_words(of, logs.joints)}.")
    screened = screen(simulation, NOMINAL, rows, excluded, nominal=nominal.null)
    without_wrapper = screen_without_wrapper(simulation, NOMINAL, rows, excluded, nominal.null)
    best = explanations[0]
    found = []
    for cause in best.causes:
        for joint, candidate in _candidates(cause, best, joints, without_wrapper).items():
            equivalents = _equivalents(cause, joint, best, explanations, joints)
            found.append(SelectedEffect(completed(simulation, candidate, nominal.present), equivalents))
    found = _with_gains(simulation, rows, refine(simulation, rows, found))
    journal.end_part("search on measured logs")
    machine = logs.machine
    of_rows = logs.sequences._replace(is_row=rows.is_used)
    encoders = encoders_of(
        nominal.simulation.sequences, of_rows, machine.lower, machine.upper, nominal.setting.speed_scale
    )
    comparison = Comparison(rows.folds, logs.config.search, tuple(nominal.at_rest.tolist()))
    ranked = sorted([*screened, *without_wrapper], key=comparison.net, reverse=True)
    return Selection(found, ranked, comparison, encoders)


def _rows(
    simulation: Simulation,
    rows: ScoredRows,
    purpose: np.ndarray | None,
    excluded: Sequence[str],
    speed_scale: np.ndarray,
) -> Rows:
    velocity = rows.averaged(simulation.velocities([NOMINAL])[0])
    facts = facts_of(simulation.sequences, rows, velocity, speed_scale, purpose)
    is_used = np.ones(len(velocity), bool)
    return Rows(columns_of(simulation, rows, excluded), facts, velocity, rows.weight, is_used)


def _candidates(
    cause: Cause,
    explanation: Explanation,
    joints: Sequence[JointEvidence],
    without_wrapper: Sequence[Candidate],
) -> Mapping[int, Candidate]:
    """By joint, with the coefficients that are most probable in the explanation."""
    if not cause.terms:
        of_family = {c.joint: c for c in without_wrapper if c.family == cause.family}
        return {joint: of_family[joint] for joint in cause.joints}
    result = {}
    for joint, index in cause.terms.items():
        evidence = joints[joint]
        beside = [of.terms[joint] for of in explanation.causes if joint in of.terms]
        values = dict(
            zip(evidence.prior(sorted(beside)).columns, evidence.fit(beside).coefficients, strict=True)
        )
        result[joint] = _candidate(evidence, index, values)
    return result


def _candidate(evidence: JointEvidence, index: int, values: Mapping[int, float]) -> Candidate:
    term, onset = evidence.terms[index], evidence.onsets[index]
    coefficients = np.array([values[column] for column in term.columns] if term.freed else [])
    if term.freed:
        coefficients = np.clip(coefficients, term.lower, term.upper)
    around = int(ONSET_STEP_S * 1e9)
    return Candidate(
        DELAY
        if term.family == TIMING
        else term.family,  # on each joint; equal delays of all are told as timing
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
    cause: Cause,
    joint: int,
    best: Explanation,
    explanations: Sequence[Explanation],
    joints: Sequence[JointEvidence],
) -> list[Candidate]:
    """What may stand in the place of a cause on a joint: until the credible set is full, most probable first."""
    others = [of for of in best.causes if of is not cause]
    kept = {of.label for of in others}
    held, result, named = 0.0, [], {cause.family}
    for explanation in explanations:
        if held >= CREDIBLE:
            break
        held += explanation.probability
        for rival in explanation.causes:
            index = rival.terms.get(joint)
            if index is None or rival.label in kept or rival.family in named:
                continue
            named.add(rival.family)
            of_joint = [of.terms[joint] for of in explanation.causes if joint in of.terms]
            evidence = joints[joint]
            columns, found = evidence.prior(sorted(of_joint)).columns, evidence.fit(of_joint).coefficients
            result.append(_candidate(evidence, index, dict(zip(columns, found, strict=True))))
    return result


def _with_gains(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]
) -> list[SelectedEffect]:
    """Effects with what each takes off the squares beside the others."""
    after = residual_of(simulation, rows, found)
    result = []
    for effect in found:
        candidate = effect.candidate
        if candidate.family in WITHOUT_WRAPPER:
            result.append(effect)
            continue
        joint, floor = candidate.joint, rows.floor[candidate.joint]
        before = residual_of(simulation, rows, [of for of in found if of is not effect])[:, joint]
        taken = np.bincount(rows.folds.block, before**2 - after[:, joint] ** 2, minlength=rows.folds.n_blocks)
        share = float(taken.sum()) / max(float(np.sum(before**2)), 1e-12)
        of = replace(candidate, gain=float(taken.sum() / floor), share=share, gain_by_block=taken / floor)
        result.append(replace(effect, candidate=of))
    return result


def _in_words(explanation: Explanation, joints: Sequence[str]) -> str:
    if not explanation.causes:
        return "no effect"
    return " and ".join(
        f"{cause.family}{' that sets in' if cause.sets_in else ''} on {', '.join(joints[j] for j in cause.joints)}"
        for cause in explanation.causes
    )
