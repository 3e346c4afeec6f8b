"""closed_loop.json (contract, section 4) of a verdict."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.e_value import as_told
from pipeline.discrepancy.acceptance.parameters import parameters_of
from pipeline.discrepancy.acceptance.power import Visible
from pipeline.discrepancy.acceptance.probability_none import probability_none
from pipeline.discrepancy.correction.correct import Alternative
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.families.contract_parameters import units_of
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
from pipeline.dynamics.comparison import ONE_STEP, OPEN_LOOP
from pipeline.logs.tuples import Trajectory


def document_of(verdict: Verdict) -> dict[str, Any]:
    """The content of the file."""
    diagnosis, joints = verdict.diagnosis, verdict.logs.joints
    word, entries = _word_and_entries(verdict)
    idle = [name for index, name in enumerate(joints) if index not in diagnosis.excited]
    first = next((entry["joints"][0] for entry in entries[:1] if entry["joints"]), None)
    return {
        "detected": None if word == "unexcited" else bool(entries),
        "verdict": word,
        "effects": entries,
        **({"known": known_entries(verdict)} if diagnosis.known else {}),
        "probability_none": probability_none([of["e_value"] for of in entries], word != "unexcited"),
        "power": [_visible(verdict, of) for of in verdict.acceptance.power],
        "alternatives": [_alternative(verdict, of) for of in verdict.correction.alternatives],
        "error": _errors(verdict),
        "baselines": _baselines(verdict),
        "held_out": _held_out(verdict),
        "next_experiment": verdict.plan.sentence
        if verdict.plan is not None
        else next_experiment(word, _families(verdict), first, idle),
        "trace": trace_of(verdict),
    }


def _word_and_entries(verdict: Verdict) -> tuple[str, list[dict[str, Any]]]:
    """The verdict, and the effects as they are told."""
    diagnosis, correction = verdict.diagnosis, verdict.correction
    if effects := correction.new:
        told = zip(effects, correction.error_reductions, strict=True)
        entries = [_entry(verdict, effect, reduction) for effect, reduction in told]
        if effects[0].family == OTHER:
            return "outside_catalogue", entries
        return "ambiguous" if effects[0].equivalents else "named", entries
    if strange := unexplained(diagnosis, verdict.selection, verdict.acceptance):
        return "outside_catalogue", strange
    is_idle = len(diagnosis.excited) * 2 < len(verdict.logs.joints)
    return "unexcited" if is_idle else "none", []


def _families(verdict: Verdict) -> list[str]:
    """Of the strongest effect and of its equivalents."""
    return [
        name
        for effect in verdict.correction.new[:1]
        for name in (effect.card, *(e.family for e in effect.equivalents))
    ]


def _errors(verdict: Verdict) -> dict[str, Any]:
    joints, errors = verdict.logs.joints, verdict.correction.errors
    return {
        name: {
            when: _by_joint(joints, of.rmse)
            for when, of in zip(("before", "after"), errors[horizon], strict=True)
        }
        for name, horizon in ((ONE_STEP, 1), (OPEN_LOOP, 80))
    }


def _baselines(verdict: Verdict) -> dict[str, Any]:
    correction = verdict.correction
    errors = {
        **{name: of[80] for name, of in correction.baselines.items()},
        "nominal_floor": correction.floor[80],
        **{f"{name}_on_nominal": of for name, of in correction.on_nominal.items()},
    }
    return {name: {OPEN_LOOP: _by_joint(verdict.logs.joints, of)} for name, of in errors.items()}


def _held_out(verdict: Verdict) -> dict[str, Any]:
    logs = verdict.logs
    rows = [purposes == Purpose.confirm for purposes in logs.purposes]
    return {
        "rule": logs.rule,
        "n_steps": int(sum(map(np.count_nonzero, rows))),
        "trajectories": [t.name for t, held_out in zip(logs.measured, rows, strict=True) if held_out.any()],
    }


def _visible(verdict: Verdict, of: Visible) -> dict[str, Any]:
    unit = units_of(verdict.logs.units[of.joint]).get(of.unit, of.unit)
    size = of.size if np.isfinite(of.size) else None
    return {"family": of.family, "joint": verdict.logs.joints[of.joint], "size": size, "unit": unit}


def _by_joint(joints: Sequence[str], values: np.ndarray) -> dict[str, float | None]:
    return {
        joint: float(value) if np.isfinite(value) else None
        for joint, value in zip(joints, values, strict=True)
    }


def _entry(verdict: Verdict, effect: MachineEffect, error_reduction: float) -> dict[str, Any]:
    logs = verdict.logs
    onset = _onset(logs.measured, effect.onset)
    entry = {
        "family": effect.family if onset is None else "change_point",
        "joints": [logs.joints[j] for j in effect.joints],
        "depends_on": depends_on(effect, logs.machine),
        "parameters": parameters_of(verdict.correction.fit, effect),
        "onset": onset,
        "certain": not effect.equivalents,
        "probability": effect.probability,
        **as_told(verdict.acceptance.judgements[effect.members[0].candidate.key].e_value),
        "error_reduction": error_reduction,
    }
    return {**entry, "of": effect.family} if onset is not None else entry


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
    entry: dict[str, Any] = {
        "family": family,
        "joints": [verdict.logs.joints[joint]],
        **(
            {"depends_on": candidate_depends_on(of.candidate, verdict.logs.machine)}
            if family == OTHER
            else {}
        ),
        "probability": of.probability,
        "error_reduction": of.error_reduction,
        "why_not": of.why_not or f"these logs cannot tell it from {of.chosen}",
    }
    return {**entry, "equivalent": True} if of.why_not is None else entry
