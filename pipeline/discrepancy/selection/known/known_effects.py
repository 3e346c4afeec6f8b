"""The effects of a given model in the terms of a search on measured logs, with their values as a prior."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import SENSOR_BIAS
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.linear_parameters import freed_of
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect
from pipeline.effects.dependence import Dependence
from pipeline.effects.effect import Effect, Freed, Variant
from pipeline.effects.store import ActiveEffects
from pipeline.effects.varying_speed import FAMILY as VARYING_SPEED

Place = tuple[str, tuple[int, ...]]
"""Parameter, and index in its row of one joint."""

FOLLOWED = {"common_std": SUPPLY, "own_std": COURSE}  # what a filter follows, by its parameter


def known_effects(
    effects: ActiveEffects, simulation: Simulation, correlated: np.ndarray
) -> list[SelectedEffect]:
    """Effects of a model, one per joint and source, with their values as a prior.

    An onset that lies before all rows is none in these logs.

    Args:
        effects: Around the model.
        simulation: On the measured logs; what it does not know is left out.
        correlated: (n_joint,) rows of a log that count as one in a fit.
    """
    first = simulation.sequences.stamp_ns[simulation.sequences.is_row].min()
    found = []
    for family, values in effects.values.items():
        if family == VARYING_SPEED:
            found += _followed(values)
        effect = simulation.effects.get(family)
        if effect is None:
            continue
        for joint in range(simulation.setting.n_joint):
            onset = effects.onset_ns.get(family, {}).get(joint)
            for source, changes in _by_source(effect, values, joint):
                candidate = _candidate(effect, joint, source, values, changes)
                known = Known(
                    replace(candidate, onset=onset),
                    _deviations(candidate, effects.deviations.get(family, {})),
                    float(correlated[joint]),
                )
                is_within = onset is not None and onset > first
                found.append(
                    SelectedEffect(replace(candidate, onset=onset if is_within else None), known=known)
                )
    return found


def _followed(values: Mapping[str, np.ndarray]) -> list[SelectedEffect]:
    """What has no equation, and which the model follows by a filter."""
    candidates = [
        Candidate(family, joint, None, {}, (), np.zeros(0), 0.0, 0.0, np.zeros(0))
        for name, family in FOLLOWED.items()
        for joint in np.flatnonzero(values[name]).tolist()
    ]
    return [SelectedEffect(candidate, known=Known(candidate)) for candidate in candidates]


def _by_source(
    effect: Effect, values: Mapping[str, np.ndarray], joint: int
) -> Iterator[tuple[int | None, dict[Place, float]]]:
    """Changes from neutral values on a joint; of a dependence on joints, one part per source."""
    neutral = effect.neutral()
    changes = {
        (name, index): float(value[joint][index] - neutral[name][joint][index])
        for name, value in values.items()
        for index in np.ndindex(np.shape(value[joint]))
        if value[joint][index] != neutral[name][joint][index]
    }
    if not isinstance(effect, Dependence) or not effect.per_source:
        if changes:
            yield None, changes
        return
    for source in sorted({index[1] for _, index in changes}):
        yield source, {place: change for place, change in changes.items() if place[1][1] == source}


def _candidate(
    effect: Effect,
    joint: int,
    source: int | None,
    values: Mapping[str, np.ndarray],
    changes: Mapping[Place, float],
) -> Candidate:
    grid = [set(point) for point in effect.grid()]
    of_any, of_all = set().union(*grid), set.intersection(*grid) if grid else set()
    of_point = of_all | set(effect.fitted_later()) | {name for name, _ in changes if name in of_any}
    linear = {place: change for place, change in changes.items() if place[0] not in of_point}
    freed = _freed(effect, source, linear)
    return Candidate(
        effect.card.family,
        joint,
        source,
        {name: float(values[name][joint]) for name in sorted(of_point)},
        freed,
        np.array([linear.get(_place(one[0]), 0.0) for one in freed]),
        gain=0.0,
        share=0.0,
        gain_by_block=np.zeros(0),
    )


def _freed(effect: Effect, source: int | None, changes: Mapping[Place, float]) -> Variant:
    """The smallest variant that makes the changes; else each by itself."""
    later = (*effect.freed_later(), *effect.freed_beside_nominal())
    variants = [freed_of(effect, source or 0)] if isinstance(effect, Dependence) else effect.variants()
    whole = [(*variant, *(one for one in later if one not in variant)) for variant in variants]
    by_itself = tuple(((name, _index(index)),) for name, index in changes)
    return next(
        (of for of in sorted([*variants, *whole], key=len) if _makes(of, changes)),
        by_itself,
    )


def _makes(freed: Variant, changes: Mapping[Place, float]) -> bool:
    """Whether what moves together has changed alike, and nothing else has changed."""
    groups = [[_place(one) for one in of] for of in freed]
    alike = all(len({changes.get(place, 0.0) for place in group}) == 1 for group in groups)
    return alike and set(changes) <= {place for group in groups for place in group}


def _place(of: tuple[str, int | tuple[int, ...] | None]) -> Place:
    name, index = of
    return name, () if index is None else tuple(np.atleast_1d(index).tolist())


def _index(index: tuple[int, ...]) -> int | tuple[int, ...] | None:
    return None if not index else index[0] if len(index) == 1 else index


def _deviations(candidate: Candidate, of: Mapping[str, np.ndarray]) -> dict[str, float]:
    """By name, as of `Known`."""

    def at(freed: Freed) -> float:
        name, index = _place(freed[0])
        return float(of[name][(candidate.joint, *index)]) if name in of else 0.0

    found = {name: float(of[name][candidate.joint]) for name in candidate.point if name in of}
    return found | {f"coefficient:{number}": at(freed) for number, freed in enumerate(candidate.freed)}


def with_encoders(
    known: Sequence[SelectedEffect], seen: Sequence[SelectedEffect], stops_met: Collection[int]
) -> list[SelectedEffect]:
    """Known effects that have an equation, and encoders' errors as the stops show them today, where they were met.

    Args:
        known: Of the given model.
        seen: Errors of encoders that stops show.
        stops_met: Joints whose stops were met.
    """
    by_key = {effect.candidate.key: effect.known for effect in known}
    kept = [
        effect
        for effect in known
        if has_wrapper(effect.candidate)
        and not (effect.candidate.family == SENSOR_BIAS and effect.candidate.joint in stops_met)
    ]
    return kept + [replace(effect, known=by_key.get(effect.candidate.key)) for effect in seen]


def as_known(found: Sequence[SelectedEffect], known: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Effects of which those without an equation that the given model follows are known."""
    by_key = {effect.candidate.key: effect.known for effect in known}
    return [
        effect if effect.known is not None else replace(effect, known=by_key.get(effect.candidate.key))
        for effect in found
    ]
