"""What became of the effects that the given model has: still as they were, grown, shrunk, gone, or not to be seen."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects, grouped
from pipeline.discrepancy.acceptance.parameters import parameters_of
from pipeline.discrepancy.families.contract_parameters import spreads
from pipeline.discrepancy.selection.free_parameters import Coordinate, coordinates_of, value_of
from pipeline.discrepancy.selection.grouping import MachineEffect, depends_on
from pipeline.discrepancy.selection.known.prior import name_of
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.discrepancy.verdict.verdict import Verdict
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.draws import OF_95_PERCENT

UNCHANGED, GROWN, SHRUNK, GONE, UNSEEN = "unchanged", "grown", "shrunk", "gone", "unseen"


class AsItWas(FittedEffects):
    """Known effects with the values that they had."""

    @property
    def covariance(self) -> Mapping[int, tuple[list[Coordinate], np.ndarray]]:  # type: ignore[override]
        """Per joint its coordinates, and their variances without what `spreads` adds."""
        error = self.diagnosis.logs.config.gate.model_error
        result = {}
        for joint, coordinates in coordinates_of(self.diagnosis.simulation, self.found).items():
            variances = []
            for coordinate in coordinates:
                known = self.found[coordinate.effect].known
                assert known is not None
                value = known.value_of(coordinate.name, coordinate.index)
                variances.append(known.deviations.get(name_of(coordinate), 0.0) ** 2 - (error * value) ** 2)
            result[joint] = (coordinates, np.diag(np.maximum(variances, 0.0)))
        return result


def known_entries(verdict: Verdict) -> list[dict[str, Any]]:
    """`known` of closed_loop.json: one entry per effect and state, in the order of the given model's strongest."""
    logs, now = verdict.logs, verdict.correction.fit
    present = {f.candidate.key: f for f in now.found if f.known is not None}
    before = AsItWas(verdict.diagnosis, verdict.diagnosis.known, [])
    entries = []
    for effect in grouped(verdict.diagnosis, verdict.diagnosis.known).effects:
        states = {id(f): _state(now, present.get(f.candidate.key)) for f in effect.members}
        for state in dict.fromkeys(states.values()):
            members = [f for f in effect.members if states[id(f)] == state]
            part = MachineEffect(effect.family, members)
            left = [present[f.candidate.key] for f in members if f.candidate.key in present]
            entries.append(
                {
                    "family": effect.family,
                    "joints": [logs.joints[joint] for joint in part.joints],
                    "depends_on": depends_on(part, logs.machine),
                    "state": state,
                    "before": parameters_of(before, part, of_logs=False),
                    "now": parameters_of(now, MachineEffect(effect.family, left), of_logs=False)
                    if left
                    else None,
                }
            )
    return entries


def _state(fit: FittedEffects, effect: SelectedEffect | None) -> str:
    if effect is None:
        return GONE
    assert effect.known is not None
    if not effect.known.is_seen:
        return UNSEEN
    largest, is_larger = 0.0, False
    candidate, number = effect.candidate, next(i for i, f in enumerate(fit.found) if f is effect)
    coordinates, covariance = fit.covariance.get(candidate.joint, ([], np.zeros((0, 0))))
    error = fit.diagnosis.logs.config.gate.model_error
    spread = spreads(coordinates, covariance, number, candidate, error)
    neutral = {p.name: p.neutral for p in KNOWN[candidate.family].card.parameters} if coordinates else {}
    for coordinate in (of for of in coordinates if of.effect == number):
        name = name_of(coordinate)
        was = effect.known.value_of(coordinate.name, coordinate.index)
        of_fit = value_of(fit.found, coordinate)
        deviation = float(np.hypot(spread[name].deviation, effect.known.deviations.get(name, 0.0)))
        off = abs(of_fit - was) / max(deviation, 1e-12)
        if off > largest:
            nothing = neutral[coordinate.name] if coordinate.name else 0.0
            largest, is_larger = off, abs(of_fit - nothing) > abs(was - nothing)
    return UNCHANGED if largest <= OF_95_PERCENT else GROWN if is_larger else SHRUNK


def known_in_words(entries: Sequence[Mapping[str, Any]]) -> str:
    """For the terminal: `delay on swing unchanged, gain on boom grown`."""
    return ", ".join(f"{of['family']} on {' and '.join(of['joints'])} {of['state']}" for of in entries)
