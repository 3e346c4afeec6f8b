"""The contract's parameters of effects that were fitted, each with its unit and its interval."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.families.contract_parameters import (
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
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.onset import rows_since
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.draws import OF_95_PERCENT

# Of the value, for minutes of logs and correlation times of some seconds; not estimated from the logs.
SUPPLY_DEVIATION = {"std_log_speed": 0.15, "correlation_time": 0.4}


def parameters_of(fit: FittedEffects, effect: MachineEffect, of_logs: bool = True) -> dict[str, Any]:
    """The parameters of one of the effects that were fitted, by name.

    Args:
        fit: The effects.
        effect: One of them.
        of_logs: Whether logs are asked what they show beside the fitted values; else these alone are told.
    """
    if not effect.has_wrapper:
        if not of_logs:
            return {}
        return plausible(
            _of_supply(fit, effect) if effect.family == SUPPLY else _periods(fit.diagnosis, effect)
        )
    described = [_of_member(fit, member, effect.family, of_logs) for member in effect.members]
    if effect.family == TIMING:
        described = [{"latency": of["added_delay"]} for of in described]
    if len(described) == 1:
        return plausible(described[0])
    joints = fit.diagnosis.logs.joints
    merged = of_all_joints(described, [joints[member.candidate.joint] for member in effect.members])
    if effect.family == TIMING:
        merged = {name: _beside_recordings_phases(fit.diagnosis, of) for name, of in merged.items()}
    return plausible(merged)


def _of_supply(fit: FittedEffects, effect: MachineEffect) -> dict[str, Quantity]:
    simulation, rows = fit.diagnosis.simulation, fit.diagnosis.rows
    since = rows if effect.onset is None else rows_since(simulation, rows, effect.onset)[0]
    nominal = fit.diagnosis.nominal.simulation, fit.diagnosis.nominal.rows
    values = supply_parameters((simulation, since), nominal, hypothesis_of(simulation, fit.found))
    return {
        name: quantity(values[name], unit, SUPPLY_DEVIATION[name] * values[name])
        for name, unit in (("std_log_speed", "1"), ("correlation_time", "s"))
    }


def _of_member(fit: FittedEffects, member: SelectedEffect, family: str, of_logs: bool) -> dict[str, Any]:
    """Of an effect on one joint; `family` is that of the effect of the machine which it is part of."""
    diagnosis, candidate, joint = fit.diagnosis, member.candidate, member.candidate.joint
    logs, setting = diagnosis.logs, diagnosis.nominal.setting
    number = next(i for i, f in enumerate(fit.found) if f is member)
    coordinates, covariance = fit.covariance.get(joint, ([], np.zeros((0, 0))))
    spread = spreads(coordinates, covariance, number, candidate, logs.config.gate.model_error)
    described = describe(candidate, KNOWN[candidate.family](setting), spread, logs.joints, logs.units[joint])
    if family == LOAD:
        described |= mean_speed_ratios(
            candidate,
            number,
            coordinates,
            covariance,
            setting,
            logs.sequences.q[diagnosis.rows.is_used],
            diagnosis.simulation.velocities([NOMINAL])[0][diagnosis.rows.is_used][:, joint],
            logs.config.gate.model_error,
        )
    if of_logs and family == OSCILLATION:
        described |= _as_it_rings_down(diagnosis, joint)
    if of_logs and family == STICTION and _is_alone(member, fit.found):
        described |= _as_it_starts(diagnosis, candidate, described)
    return described


def _periods(diagnosis: Diagnosis, effect: MachineEffect) -> dict[str, Quantity]:
    """Of joints whose course comes round: the logs tell frequencies apart that differ by one round in the longest."""
    longest_s = diagnosis.logs.machine.dt_s * max(map(len, diagnosis.logs.measured))
    periods = {
        diagnosis.logs.joints[member.candidate.joint]: float(member.candidate.point[PERIOD])
        for member in effect.members
        if PERIOD in member.candidate.point
    }
    return {
        (PERIOD if len(effect.members) == 1 else f"{PERIOD}:{joint}"): quantity(
            period_s, "s", 0.5 * period_s**2 / longest_s / OF_95_PERCENT
        )
        for joint, period_s in periods.items()
    }


def _as_it_rings_down(diagnosis: Diagnosis, joint: int) -> dict[str, Quantity]:
    """Frequency and damping from stops, where they show them; the wrapper's smear poses of different frequencies."""
    found = ring_down(diagnosis.logs.sequences, diagnosis.rows.is_used, joint, diagnosis.logs.machine.dt_s)
    if found is None:
        return {}
    error = diagnosis.logs.config.gate.model_error
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


def _as_it_starts(
    diagnosis: Diagnosis, candidate: Candidate, described: Mapping[str, Any]
) -> dict[str, Quantity]:
    """Extra time until there is motion, and the threshold of the joint's rest; the wrapper's are of its command."""
    threshold, extra = described["rest_threshold"], described["mean_extra_time"]
    is_row = diagnosis.rows.is_used
    if candidate.onset is not None:
        acts_from = candidate.onset if candidate.onset_between is None else candidate.onset_between[1]
        is_row = is_row & (diagnosis.logs.sequences.stamp_ns >= acts_from)
    rows = diagnosis.logs.sequences._replace(is_row=is_row)
    late = late_starts(
        (diagnosis.nominal.simulation.sequences, diagnosis.nominal.phases),
        (rows, diagnosis.phases),
        candidate.joint,
        threshold["value"],
        diagnosis.nominal.setting.speed_scale[candidate.joint],
        diagnosis.logs.machine.dt_s,
    )
    if late is None or late.extra_s <= 0.0:
        return {}
    told = _until_it_moves(late, diagnosis.logs.config.gate.model_error)
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


def _beside_recordings_phases(diagnosis: Diagnosis, latency: Mapping[str, Any]) -> Quantity:
    """A late channel's latency, known no better than the moments between two ticks at which recordings began."""
    n_logs = [
        int(rows.any(axis=1).sum()) for rows in (diagnosis.rows.is_used, diagnosis.nominal.rows.is_used)
    ]
    of_phases = diagnosis.logs.machine.dt_s * np.sqrt((1.0 / n_logs[0] + 1.0 / n_logs[1]) / 12.0)
    return quantity(latency["value"], "s", float(np.hypot(deviation_of(latency), of_phases)), latency[WIDEST])
