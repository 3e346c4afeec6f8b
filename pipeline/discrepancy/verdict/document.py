"""closed_loop.json (contract, section 4) from a loop that has opened its confirmation rows."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.families.contract_parameters import (
    OF_95_PERCENT,
    WIDEST,
    Quantity,
    describe,
    deviation_of,
    of_all_joints,
    plausible,
    quantity,
    spreads,
)
from pipeline.discrepancy.families.late_starts import LateStarts, late_starts
from pipeline.discrepancy.families.load_over_poses import mean_speed_ratios
from pipeline.discrepancy.families.plausibility import LEAKAGE, LOAD, OSCILLATION, STICTION, TIMING
from pipeline.discrepancy.families.ring_down import ring_down
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import supply_parameters
from pipeline.discrepancy.families.time_varying_gain import PERIOD
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import OTHER, MachineEffect, contract_family, depends_on
from pipeline.discrepancy.selection.onset import rows_since
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from pipeline.discrepancy.verdict.next_experiment import next_experiment
from pipeline.discrepancy.verdict.unexplained import unexplained
from pipeline.effects.catalogue import KNOWN

if TYPE_CHECKING:
    from pipeline.discrepancy.close_loop import Loop

# Of the value, for minutes of logs and correlation times of some seconds; not estimated from the logs.
SUPPLY_DEVIATION = {"std_log_speed": 0.15, "correlation_time": 0.4}


def document_of(
    loop: "Loop",
    effects: Sequence[MachineEffect],
    errors: Mapping[int, tuple[WindowErrors, WindowErrors]],
    floor: Mapping[int, np.ndarray],
    baselines: Mapping[str, Mapping[int, np.ndarray]],
    on_nominal: Mapping[str, np.ndarray],
) -> dict[str, Any]:
    """Write it down; `on_nominal` are errors over 80 steps on nominal logs, of what corrects the model."""
    entries = [_entry(loop, effect) for effect in effects]
    strange = unexplained(loop) if not effects else []
    alternatives = _alternatives(loop, effects)
    is_idle = len(loop.excited) * 2 < len(loop.joints)
    if entries:
        verdict = (
            "outside_catalogue"
            if effects[0].family == OTHER
            else "ambiguous"
            if effects[0].equivalents
            else "named"
        )
    elif strange:
        verdict, entries = "outside_catalogue", strange
    else:
        verdict = "unexcited" if is_idle else "none"
    held_out = [p == Purpose.confirm for p in loop.purposes]
    first = entries[0] if entries else None
    families = [effects[0].card, *(e.family for e in effects[0].equivalents)] if effects else []
    idle = [name for index, name in enumerate(loop.joints) if index not in loop.excited]
    return {
        "detected": None if verdict == "unexcited" else bool(entries),
        "verdict": verdict,
        "effects": entries,
        "alternatives": alternatives,
        "error": {
            "one_step_rmse": {
                "before": _by_joint(loop, errors[1][0].rmse),
                "after": _by_joint(loop, errors[1][1].rmse),
            },
            "open_loop_rmse_80": {
                "before": _by_joint(loop, errors[80][0].rmse),
                "after": _by_joint(loop, errors[80][1].rmse),
            },
        },
        "baselines": {
            **{name: {"open_loop_rmse_80": _by_joint(loop, of[80])} for name, of in baselines.items()},
            "nominal_floor": {"open_loop_rmse_80": _by_joint(loop, floor[80])},
            **{
                f"{name}_on_nominal": {"open_loop_rmse_80": _by_joint(loop, of)}
                for name, of in on_nominal.items()
            },
        },
        "held_out": {
            "rule": loop.rule,
            "n_steps": int(sum(rows.sum() for rows in held_out)),
            "trajectories": [t.name for t, rows in zip(loop.measured, held_out, strict=True) if rows.any()],
        },
        "next_experiment": next_experiment(
            verdict, families, first["joints"][0] if first and first["joints"] else None, idle
        ),
    }


def _by_joint(loop: "Loop", values: np.ndarray) -> dict[str, float | None]:
    return {
        joint: float(value) if np.isfinite(value) else None
        for joint, value in zip(loop.joints, values, strict=True)
    }


def _entry(loop: "Loop", effect: MachineEffect) -> dict:
    joints = effect.joints
    onset = _onset(loop, effect.onset)
    family = effect.family
    entry = {
        "family": family if onset is None else "change_point",
        "joints": [loop.joints[j] for j in joints],
        "depends_on": depends_on(effect, loop.joints),
        "parameters": parameters_of(loop, effect),
        "onset": onset,
        "certain": not effect.equivalents,
        "p_value": float(min(loop.judgements[m.candidate.key].p_value for m in effect.members)),
        "error_reduction": loop.open_loop.error_reduction(effect),
    }
    return {**entry, "of": family} if onset is not None else entry


def _onset(loop: "Loop", stamp_ns: int | None) -> dict | None:
    """The first row from which on an effect acts: whichever log it is in, folders are in no order of time."""
    if stamp_ns is None:
        return None
    rows = [
        (int(trajectory.stamp_ns[place]), number, place)
        for number, trajectory in enumerate(loop.measured)
        if (place := int(np.searchsorted(trajectory.stamp_ns, stamp_ns))) < len(trajectory)
    ]
    if not rows:
        return None
    _, number, place = min(rows)
    trajectory = loop.measured[number]
    return {"trajectory": trajectory.name, "t": float(trajectory.t_s[place])}


def parameters_of(loop: "Loop", effect: MachineEffect) -> dict:
    """The contract's parameters of an effect found, each with unit and interval."""
    found = loop.search.found
    if effect.family == SUPPLY:
        rows = loop.rows if effect.onset is None else rows_since(loop.simulation, loop.rows, effect.onset)[0]
        measured, nominal = (loop.simulation, rows), (loop.usual.simulation, loop.usual.rows)
        values = supply_parameters(measured, nominal, hypothesis_of(loop.simulation, found))
        return plausible(
            {
                name: quantity(values[name], unit, SUPPLY_DEVIATION[name] * values[name])
                for name, unit in (("std_log_speed", "1"), ("correlation_time", "s"))
            }
        )
    if not effect.has_wrapper:
        return plausible(_periods(loop, effect))
    described = []
    for member in effect.members:
        joint = member.candidate.joint
        number = next(i for i, f in enumerate(found) if f is member)
        coordinates, covariance = loop.covariance.get(joint, ([], np.zeros((0, 0))))
        spread = spreads(coordinates, covariance, number, member.candidate, loop.config.gate.model_error)
        wrapper = KNOWN[member.candidate.family](loop.usual.setting)
        described.append(describe(member.candidate, wrapper, spread, loop.joints, loop.units[joint]))
        if effect.family == LOAD:
            described[-1] |= mean_speed_ratios(
                member.candidate,
                number,
                coordinates,
                covariance,
                loop.usual.setting,
                loop.sequences.q[loop.rows.is_used],
                loop.simulation.velocities([NOMINAL])[0][loop.rows.is_used][:, joint],
                loop.config.gate.model_error,
            )
        if effect.family == OSCILLATION:
            described[-1] |= _as_it_rings_down(loop, joint)
        if effect.family == STICTION and _is_alone(member, found):
            described[-1] |= _as_it_starts(loop, member.candidate, described[-1])
    if effect.family == TIMING:
        described = [{"latency": of["added_delay"]} for of in described]
    if len(described) == 1:
        return plausible(described[0])
    merged = of_all_joints(described, [loop.joints[member.candidate.joint] for member in effect.members])
    if effect.family == TIMING:
        merged = {name: _beside_recordings_phases(loop, latency) for name, latency in merged.items()}
    return plausible(merged)


def _periods(loop: "Loop", effect: MachineEffect) -> dict[str, Quantity]:
    """Of joints whose course comes round: the logs tell frequencies apart that differ by one round in the longest."""
    longest_s = loop.machine.dt_s * max(map(len, loop.measured))
    periods = {
        loop.joints[member.candidate.joint]: float(member.candidate.point[PERIOD])
        for member in effect.members
        if PERIOD in member.candidate.point
    }
    return {
        (PERIOD if len(effect.members) == 1 else f"{PERIOD}:{joint}"): quantity(
            period_s, "s", 0.5 * period_s**2 / longest_s / OF_95_PERCENT
        )
        for joint, period_s in periods.items()
    }


def _as_it_rings_down(loop: "Loop", joint: int) -> dict[str, Quantity]:
    """Frequency and damping from stops, where they show them; the wrapper's smear poses of different frequencies."""
    found = ring_down(loop.sequences, loop.rows.is_used, joint, loop.machine.dt_s)
    if found is None:
        return {}
    error = loop.config.gate.model_error
    return {
        "frequency": quantity(
            found.frequency_hz,
            "Hz",
            float(np.hypot(found.frequency_deviation_hz, error * found.frequency_hz)),
        ),
        "damping_ratio": quantity(
            found.damping_ratio, "1", float(np.hypot(found.damping_deviation, error * found.damping_ratio))
        ),
    }


def _is_alone(member: SelectedEffect, found: Sequence[SelectedEffect]) -> bool:
    """Whether nothing else was found on the joint, which may start late for that; a leak lets it start when it does."""
    beside = [f for f in found if f is not member and f.candidate.joint == member.candidate.joint]
    return all(f.candidate.family == LEAKAGE for f in beside)


def _as_it_starts(loop: "Loop", candidate: Candidate, described: Mapping[str, Any]) -> dict[str, Quantity]:
    """Extra time until there is motion, and the threshold of the joint's rest; the wrapper's are of its command."""
    threshold, extra = described["rest_threshold"], described["mean_extra_time"]
    is_row = loop.rows.is_used
    if candidate.onset is not None:
        acts_from = candidate.onset if candidate.onset_between is None else candidate.onset_between[1]
        is_row = is_row & (loop.sequences.stamp_ns >= acts_from)
    rows = loop.sequences._replace(is_row=is_row)
    late = late_starts(
        (loop.usual.simulation.sequences, loop.usual.phases),
        (rows, loop.phases),
        candidate.joint,
        threshold["value"],
        loop.usual.setting.speed_scale[candidate.joint],
        loop.machine.dt_s,
    )
    if late is None or late.extra_s <= 0.0:
        return {}
    told = _until_it_moves(late, loop.config.gate.model_error)
    if late.stopping_s >= threshold["value"]:
        return told | {"mean_extra_time_of_command": extra}
    # Whether a rest is the command's or the joint's nobody says: the interval holds both.
    of_rest = float(np.hypot(deviation_of(threshold), late.stopping_s / OF_95_PERCENT))
    return {
        **told,
        "rest_threshold": quantity(threshold["value"] - late.stopping_s, "s", of_rest, threshold[WIDEST]),
        "mean_extra_time_of_command": extra,
        "rest_threshold_of_command": threshold,
    }


def _until_it_moves(late: LateStarts, model_error: float) -> dict[str, Quantity]:
    deviation = float(np.hypot(late.extra_deviation_s, model_error * late.extra_s))
    return {"mean_extra_time": quantity(late.extra_s, "s", deviation)}


def _beside_recordings_phases(loop: "Loop", latency: Mapping[str, Any]) -> Quantity:
    """A late channel's latency, known no better than the moments between two ticks at which recordings began."""
    n_logs = [int(rows.any(axis=1).sum()) for rows in (loop.rows.is_used, loop.usual.rows.is_used)]
    of_phases = loop.machine.dt_s * np.sqrt((1.0 / n_logs[0] + 1.0 / n_logs[1]) / 12.0)
    return quantity(latency["value"], "s", float(np.hypot(deviation_of(latency), of_phases)), latency[WIDEST])


def _alternatives(loop: "Loop", effects: Sequence[MachineEffect]) -> list[dict]:
    entries: list[dict[str, Any]] = []
    for effect in effects:
        for member in effect.members:
            name = effect.family if effect.family != OTHER else member.candidate.family
            rivals = [(c, None) for c in member.equivalents] if effect.equivalents else []
            for candidate, why in [*rivals, *member.losers]:
                rival = MachineEffect(contract_family(candidate), [SelectedEffect(candidate)])
                entry = {
                    "family": rival.family,
                    "joints": [loop.joints[candidate.joint]],
                    "error_reduction": loop.open_loop.error_reduction(rival),
                    "why_not": why or f"these logs cannot tell it from {name}",
                }
                if why is None:
                    entry["equivalent"] = True
                entries.append(entry)
    return entries
