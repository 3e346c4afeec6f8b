"""closed_loop.json (contract, section 4) of a verdict."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.confirmation import Confirmed
from pipeline.discrepancy.acceptance.parameters import parameters_of
from pipeline.discrepancy.correction.correct import Alternative
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.posterior.e_values import e_value_of
from pipeline.discrepancy.posterior.select_by_posterior import CREDIBLE
from pipeline.discrepancy.selection.grouping import (
    OTHER,
    MachineEffect,
    candidate_depends_on,
    contract_family,
    depends_on,
)
from pipeline.discrepancy.verdict.known import known_entries
from pipeline.discrepancy.verdict.next_experiment import next_experiment
from pipeline.discrepancy.verdict.trace import trace_of
from pipeline.discrepancy.verdict.unexplained import unexplained
from pipeline.discrepancy.verdict.verdict import Verdict
from pipeline.logs.tuples import Trajectory


def document_of(verdict: Verdict) -> dict[str, Any]:
    """The content of the file."""
    diagnosis, logs, correction = verdict.diagnosis, verdict.logs, verdict.correction
    effects, errors = correction.new, correction.errors
    entries = [
        _entry(verdict, effect, reduction)
        for effect, reduction in zip(effects, correction.error_reductions, strict=True)
    ]
    strange = unexplained(diagnosis, verdict.selection, verdict.acceptance) if not effects else []
    is_idle = len(diagnosis.excited) * 2 < len(logs.joints)
    if entries:
        word = (
            "outside_catalogue"
            if effects[0].family == OTHER
            else "ambiguous"
            if effects[0].equivalents
            else "named"
        )
    elif strange:
        word, entries = "outside_catalogue", strange
    else:
        word = "unexcited" if is_idle else "none"
    held_out = [p == Purpose.confirm for p in logs.purposes]
    first = entries[0] if entries else None
    families = [effects[0].card, *(e.family for e in effects[0].equivalents)] if effects else []
    idle = [name for index, name in enumerate(logs.joints) if index not in diagnosis.excited]
    return {
        "detected": None if word == "unexcited" else bool(entries),
        "verdict": word,
        "effects": entries,
        **({"known": known_entries(verdict)} if diagnosis.known else {}),
        **_of_posterior(verdict),
        "alternatives": [_alternative(verdict, of) for of in correction.alternatives],
        "error": {
            "one_step_rmse": {
                "before": _by_joint(logs.joints, errors[1][0].rmse),
                "after": _by_joint(logs.joints, errors[1][1].rmse),
            },
            "open_loop_rmse_80": {
                "before": _by_joint(logs.joints, errors[80][0].rmse),
                "after": _by_joint(logs.joints, errors[80][1].rmse),
            },
        },
        "baselines": {
            **{
                name: {"open_loop_rmse_80": _by_joint(logs.joints, of[80])}
                for name, of in correction.baselines.items()
            },
            "nominal_floor": {"open_loop_rmse_80": _by_joint(logs.joints, correction.floor[80])},
            **{
                f"{name}_on_nominal": {"open_loop_rmse_80": _by_joint(logs.joints, of)}
                for name, of in correction.on_nominal.items()
            },
        },
        "held_out": {
            "rule": logs.rule,
            "n_steps": int(sum(rows.sum() for rows in held_out)),
            "trajectories": [t.name for t, rows in zip(logs.measured, held_out, strict=True) if rows.any()],
        },
        "next_experiment": verdict.plan.sentence
        if verdict.plan is not None
        else next_experiment(word, families, first["joints"][0] if first and first["joints"] else None, idle),
        "trace": trace_of(verdict),
    }


def _of_posterior(verdict: Verdict) -> dict[str, Any]:
    acceptance = verdict.acceptance
    if acceptance.probability_none is None:
        return {}
    power = [
        {
            **of._asdict(),
            "joint": verdict.logs.joints[of.joint],
            "size": of.size if np.isfinite(of.size) else None,
        }
        for of in acceptance.power
    ]
    return {"probability_none": acceptance.probability_none, "power": power}


def _by_joint(joints: Sequence[str], values: np.ndarray) -> dict[str, float | None]:
    return {
        joint: float(value) if np.isfinite(value) else None
        for joint, value in zip(joints, values, strict=True)
    }


def _entry(verdict: Verdict, effect: MachineEffect, error_reduction: float) -> dict[str, Any]:
    logs, judgements = verdict.logs, verdict.acceptance.judgements
    onset = _onset(logs.measured, effect.onset)
    entry = {
        "family": effect.family if onset is None else "change_point",
        "joints": [logs.joints[j] for j in effect.joints],
        "depends_on": depends_on(effect, logs.machine),
        "parameters": parameters_of(verdict.correction.fit, effect),
        "onset": onset,
        "certain": not effect.equivalents,
        **_belief(judgements[effect.members[0].candidate.key]),
        "p_value": float(min(judgements[m.candidate.key].p_value for m in effect.members)),
        "error_reduction": error_reduction,
    }
    return {**entry, "of": effect.family} if onset is not None else entry


def _belief(judgement: Confirmed) -> dict[str, Any]:
    """What the posterior and confirmation rows say, where there is one."""
    if judgement.probability is None:
        return {}
    return {
        "certain": judgement.probability >= CREDIBLE,
        "probability": judgement.probability,
        "e_value": e_value_of(judgement.bound),
    }


def _onset(measured: Sequence[Trajectory], stamp_ns: int | None) -> dict[str, Any] | None:
    """The first row from which on an effect acts: whichever log it is in, folders are in no order of time."""
    if stamp_ns is None:
        return None
    rows = [
        (int(trajectory.stamp_ns[place]), number, place)
        for number, trajectory in enumerate(measured)
        if (place := int(np.searchsorted(trajectory.stamp_ns, stamp_ns))) < len(trajectory)
    ]
    if not rows:
        return None
    _, number, place = min(rows)
    return {"trajectory": measured[number].name, "t": float(measured[number].t_s[place])}


def _alternative(verdict: Verdict, of: Alternative) -> dict[str, Any]:
    family, joint = contract_family(of.candidate), of.candidate.joint
    probability = verdict.acceptance.of_rivals.get((family, joint))
    entry: dict[str, Any] = {
        "family": family,
        "joints": [verdict.logs.joints[joint]],
        **(
            {"depends_on": candidate_depends_on(of.candidate, verdict.logs.machine)}
            if family == OTHER
            else {}
        ),
        **({} if probability is None else {"probability": probability}),
        "error_reduction": of.error_reduction,
        "why_not": of.why_not or f"these logs cannot tell it from {of.chosen}",
    }
    return {**entry, "equivalent": True} if of.why_not is None else entry
