"""Plans the next experiment: manoeuvres that tell the remaining explanations apart, inside the envelope."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from pipeline.discrepancy.correction.correct import Correction
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.experiment.choose import choose
from pipeline.discrepancy.experiment.evidence import PairSums
from pipeline.discrepancy.experiment.explanations import Remaining, rivals_of, unseen_in
from pipeline.discrepancy.experiment.manoeuvres import Manoeuvre
from pipeline.discrepancy.experiment.plan import Plan, Separation, Step
from pipeline.discrepancy.experiment.predictions import Predictions
from pipeline.discrepancy.families.plausibility import THERMAL_DRIFT
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.select import Selection

LEAST = 1.0  # evidence of a plan, or of all manoeuvres together: less decides nothing
LESS = 0.9  # of the time, where a plan takes too long: with more of it the same one might be chosen again
ATTEMPTS = 10  # at a plan that stays inside; each leaves out what left the envelope


def plan_experiment(
    diagnosis: Diagnosis, selection: Selection, correction: Correction, journal: Journal
) -> Plan | None:
    """The next experiment; None: nothing is left to be told apart, or no manoeuvre tells it.

    Args:
        diagnosis: Of the measured logs.
        selection: What was sought in them.
        correction: What was found in them.
        journal: Told what remains.
    """
    remaining = rivals_of(diagnosis.simulation, correction.effects, diagnosis.logs.joints)
    if remaining is None and not correction.new:
        joints = joints_in_doubt(diagnosis, selection)
        remaining = unseen_in(diagnosis, joints) if joints else None
    plan = None if remaining is None else _planned(diagnosis, remaining, correction.floor[80])
    if plan is not None:
        journal.log(f"next experiment: {plan.sentence}")
    journal.end_part("next experiment")
    return plan


def joints_in_doubt(diagnosis: Diagnosis, selection: Selection) -> list[int]:
    """Joints on which an effect may have gone unseen, where none was told.

    Those on which the search took one that was refused, and those that hardly moved. Of logs that left neither, all of
    them, where the configuration asks for it.
    """
    every = range(len(diagnosis.logs.joints))
    refused = {effect.candidate.joint for effect in selection.found if effect.known is None}
    doubted = [joint for joint in every if joint in refused or joint not in diagnosis.excited]
    return doubted or (list(every) if diagnosis.logs.config.experiment.after_none else [])


def _planned(diagnosis: Diagnosis, remaining: Remaining, error: np.ndarray) -> Plan | None:
    """Arguments as of `Predictions`."""
    predictions = Predictions(diagnosis, remaining, error)
    config, speed = diagnosis.logs.config.experiment, diagnosis.nominal.setting.speed_scale
    manoeuvres, sums = predictions.of_library()
    remaining, sums = _without_hopeless(remaining, sums, config.rounds)
    motion_s = config.motion_s
    for _ in range(ATTEMPTS):
        chosen = choose(manoeuvres, sums, speed, motion_s, config.rounds)
        if not chosen:
            return None
        plan = _plan_of(diagnosis, remaining, predictions, [manoeuvres[of] for of in chosen])
        played = predictions.play(plan)
        if played.leaves is not None:
            at = sum(bool(step.goal) for step in plan.steps[: played.leaves + 1]) - 1
            del sums[chosen[at % len(chosen)]]
        elif played.motion_s > config.motion_s:
            motion_s *= min(config.motion_s / played.motion_s, LESS)
        else:
            separations = _separations(remaining, [sums[of] for of in chosen], config.rounds)
            told = [of for of in separations if of.evidence >= LEAST]
            if not told:
                return None
            names = {name for of in told for name in of.explanations}
            lost = [of.name for of in remaining.explanations if of.name not in names]
            return replace(
                plan,
                separations=told,
                left_out=list(dict.fromkeys([*remaining.left_out, *lost])),
                motion_s=round(played.motion_s, 2),
                duration_s=round(played.duration_s, 2),
            )
    return None


def _without_hopeless(
    remaining: Remaining, sums: Mapping[int, Sequence[PairSums]], rounds: int
) -> tuple[Remaining, dict[int, list[PairSums]]]:
    """Without the pairs that all manoeuvres together do not tell apart; what is in no other pair is left out."""
    told = []
    for number in range(len(remaining.pairs)):
        of_pair = [of[number] for of in sums.values()]
        if of_pair and reduce(PairSums.plus, of_pair).times(rounds).evidence() > LEAST:
            told.append(number)
    kept = {k for number in told for k in remaining.pairs[number]}
    lost = [of.name for k, of in enumerate(remaining.explanations) if k not in kept]
    pairs = [remaining.pairs[number] for number in told]
    left = Remaining(remaining.explanations, pairs, [*remaining.left_out, *lost])
    return left, {index: [of[number] for number in told] for index, of in sums.items() if told}


def _plan_of(
    diagnosis: Diagnosis, remaining: Remaining, predictions: Predictions, chosen: Sequence[Manoeuvre]
) -> Plan:
    logs, config = diagnosis.logs, diagnosis.logs.config.experiment
    speed, tolerance = (
        dict(zip(logs.joints, np.round(of, 4).tolist(), strict=True))
        for of in (predictions.full_speed, predictions.tolerance)
    )
    steps = []
    for manoeuvre in chosen:
        steps.append(Step(goal=dict(zip(logs.joints, np.round(manoeuvre.q, 3).tolist(), strict=True))))
        for command, seconds in manoeuvre.commands:
            given = {name: float(a) for name, a in zip(logs.joints, command, strict=True) if a}
            steps.append(Step(command=given, seconds=round(float(seconds), 3)))
    return Plan(
        logs.machine.name,
        steps * config.rounds,
        [],
        list(remaining.left_out),
        predictions.region,
        speed,
        tolerance,
        predictions.rise_s,
        round(predictions.stopping_s, 3),
        is_cold=any(THERMAL_DRIFT in of.hypothesis.values for of in remaining.explanations),
    )


def _separations(
    remaining: Remaining, of_manoeuvres: Sequence[Sequence[PairSums]], rounds: int
) -> list[Separation]:
    names = [explanation.name for explanation in remaining.explanations]
    found = []
    for number, (true, rival) in enumerate(remaining.pairs):
        total = reduce(PairSums.plus, (of[number] for of in of_manoeuvres)).times(rounds)
        found.append(Separation((names[true], names[rival]), round(total.evidence(), 2)))
    return sorted(found, key=lambda separation: separation.evidence)
