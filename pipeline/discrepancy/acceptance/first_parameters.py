"""What the first parameter of every family adds to the residual of every joint."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation
from pipeline.discrepancy.families.plausibility import TIMING
from pipeline.discrepancy.selection.grouping import OTHER, told_as
from pipeline.discrepancy.selection.linear_parameters import bounds_of, direction_of
from pipeline.effects.effect import Effect, Freed, VelocityEffect


class Change(NamedTuple):
    """By one way in which the parameter may act.

    Attributes:
        family: Name.
        joint: Index.
        point: Values of the parameters that are not linear.
        of_one: (N,) what a coefficient of one adds to the residual [rad/s, m/s].
        size_of_one: How far from neutral the parameter is then, in its card's unit.
        most: Largest plausible coefficient.
    """

    family: str
    joint: int
    point: Mapping[str, float]
    of_one: np.ndarray
    size_of_one: float
    most: float


def tried(simulation: Simulation, excluded: Collection[str]) -> dict[str, Effect]:
    """Families of the contract; a late channel is a delay of its joints."""
    return {
        family: effect
        for family, effect in simulation.effects.items()
        if family not in (*excluded, TIMING) and told_as(family) != OTHER
    }


def changes_of(simulation: Simulation, rows: ScoredRows, excluded: Collection[str]) -> Iterator[Change]:
    """Of every family in turn.

    Args:
        simulation: On the logs.
        rows: Rows in use, N of them.
        excluded: Families that are not tried.
    """
    for family, effect in tried(simulation, excluded).items():
        if any(effect.variants()):
            yield from _by_coefficients(simulation, rows, family, effect)
        else:
            yield from _by_points(simulation, rows, family, effect)


def _by_coefficients(
    simulation: Simulation, rows: ScoredRows, family: str, effect: Effect
) -> Iterator[Change]:
    first, joints = effect.card.parameters[0].name, range(simulation.setting.n_joint)
    of_first = [tuple(one for one in way if first in {name for name, _ in one}) for way in effect.variants()]
    pairs = list(product(effect.grid(), [way for way in dict.fromkeys(of_first) if way]))
    if not pairs:
        return
    hypotheses = [_at(family, effect, point, joints) for point, _ in pairs]
    together: list[Freed] = [tuple(chain(*way)) for _, way in pairs]
    directions = [direction_of(family, effect, freed, joints) for freed in together]
    u = simulation.nominal_velocities([NOMINAL])[0]
    for (point, way), tangent in zip(pairs, simulation.tangents(hypotheses, directions, u), strict=True):
        change = rows.weight * rows.averaged(tangent)
        most = float(np.abs(bounds_of(effect, way)).max())
        for joint in joints:
            yield Change(family, joint, _sized(effect, point, joint), change[:, joint], 1.0, most)


def _by_points(simulation: Simulation, rows: ScoredRows, family: str, effect: Effect) -> Iterator[Change]:
    first, n_joint = effect.card.parameters[0], simulation.setting.n_joint
    groups = [[joint] for joint in range(n_joint)] if effect.reaches_other_joints else [range(n_joint)]
    shared = simulation.nominal_velocities([NOMINAL])[0] if isinstance(effect, VelocityEffect) else None
    without = simulation.velocities([NOMINAL])[0]
    for joints in groups:
        hypotheses = [_at(family, effect, point, joints) for point in effect.grid()]
        velocities = simulation.velocities(hypotheses, shared)
        for point, velocity in zip(effect.grid(), velocities, strict=True):
            change = rows.weight * rows.averaged(velocity - without)
            for joint in joints:
                sized = _sized(effect, point, joint)
                size = abs(sized.get(first.name, first.neutral) - first.neutral)
                if size:
                    yield Change(family, joint, sized, change[:, joint], size, 1.0)


def _sized(effect: Effect, point: Mapping[str, float], joint: int) -> dict[str, float]:
    """A grid point in the joint's own lengths."""
    return {name: float(effect.sizes(name)[joint] * value) for name, value in point.items()}


def _at(family: str, effect: Effect, point: Mapping[str, float], joints: Sequence[int]) -> Hypothesis:
    of = effect.neutral()
    for name, value in point.items():
        of[name][list(joints)] = effect.sizes(name)[list(joints)] * value
    return Hypothesis({family: of})
