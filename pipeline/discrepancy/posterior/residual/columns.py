"""What every family would add to the residual: one matrix of columns per joint, and the terms that are made of them.

A term is one way in which one family may act on one joint: a point of the grid, and a variant of the parameters that
the wrapper is linear in. Its part of the residual is a sum of columns times coefficients. The coefficients of linear
parameters have mean zero before any row is seen; that of a grid point is about one, within the spacing of the grid.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation, Values
from pipeline.discrepancy.families.plausibility import DELAY, TIMING
from pipeline.discrepancy.selection.linear_parameters import USUAL_SHARE, bounds_of, direction_of, freed_of
from pipeline.effects.dependence import Dependence
from pipeline.effects.effect import Effect, Variant, VelocityEffect

BETWEEN_POINTS = 0.25  # standard deviation of the coefficient of a grid point
# A late channel is late by the same time on all joints: one factor between the points, and hardly another on each.
FACTORS_OF_ONE_CHANNEL, OF_ONE_CHANNEL = (0.8, 0.9, 1.0, 1.1, 1.25), 0.05


class Term(NamedTuple):
    """One way in which a family may act on a joint.

    Attributes:
        family: Name.
        joint: Index.
        source: Joint that it depends on; None where the family has none.
        point: Values of the nonlinear parameters.
        freed: Linear parameters, one per coefficient, or empty where the point alone is the effect.
        columns: Of the joint's matrix, one per coefficient.
        mean: Of the coefficients before any row is seen.
        scale: Their standard deviation.
        lower: Bounds of the coefficients.
        upper: Bounds.
    """

    family: str
    joint: int
    source: int | None
    point: Mapping[str, float]
    freed: Variant
    columns: tuple[int, ...]
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


class Columns(NamedTuple):
    """Of all joints, on one set of rows.

    Attributes:
        residual: (N, n_joint) without any effect, 0 where a joint does not count.
        matrices: Per joint (N, M) float32.
        terms: Of all joints.
    """

    residual: np.ndarray
    matrices: list[np.ndarray]
    terms: list[Term]


def columns_of(simulation: Simulation, rows: ScoredRows, excluded: Sequence[str] = ()) -> Columns:
    """Simulate every family on every joint.

    Args:
        simulation: On the logs.
        rows: Rows in use.
        excluded: Families that are not tried.
    """
    builder = _Builder(simulation, rows, TIMING in excluded)
    for family, effect in simulation.effects.items():
        if family in excluded or family == TIMING:
            continue
        if isinstance(effect, Dependence):
            builder.dependence(family, effect)
        else:
            builder.named(family, effect)
    return Columns(builder.residual, [np.stack(c, axis=1) for c in builder.columns], builder.terms)


def _with_what_belongs_to_them(effect: Effect) -> list[Variant]:
    """Variants, also with the parameters that do not make an effect known: what these explain is no other effect."""
    variants = effect.variants()
    later = [tuple(one for one in effect.freed_later() if one not in variant) for variant in variants]
    return [*variants, *(v + of for v, of in zip(variants, later, strict=True) if of)]


class _Builder:
    def __init__(self, simulation: Simulation, rows: ScoredRows, without_timing: bool) -> None:
        self.simulation, self.rows, self._without_timing = simulation, rows, without_timing
        self.n_joint = simulation.setting.n_joint
        self.u = simulation.nominal_velocities([NOMINAL])[0]
        self.measured = rows.averaged(simulation.sequences.velocity)
        self.residual = self._residual(simulation.velocities([NOMINAL])[0])
        self.columns: list[list[np.ndarray]] = [[] for _ in range(self.n_joint)]
        self.terms: list[Term] = []

    def _residual(self, velocity: np.ndarray) -> np.ndarray:
        return self.rows.weight * (self.measured - self.rows.averaged(velocity))

    def _tangents(
        self, hypotheses: Sequence[Hypothesis], directions: Sequence[Values]
    ) -> Iterator[np.ndarray]:
        for tangent in self.simulation.tangents(hypotheses, directions, self.u):
            yield self.rows.weight * self.rows.averaged(tangent)

    def _add(self, joint: int, column: np.ndarray) -> int:
        self.columns[joint].append(column.astype(np.float32))
        return len(self.columns[joint]) - 1

    def named(self, family: str, effect: Effect) -> None:
        """A family with grid points and linear parameters."""
        points, variants = effect.grid(), _with_what_belongs_to_them(effect)
        freed = list(dict.fromkeys(one for variant in variants for one in variant))
        if not freed:
            self._grid_points(family, effect, points)
            return
        joints = range(self.n_joint)
        hypotheses = [self._at(family, effect, point, joints) for point in points for _ in freed]
        directions = [direction_of(family, effect, one, joints) for one in freed] * len(points)
        tangents = self._tangents(hypotheses, directions)
        for point in points:
            of_point = [next(tangents) for _ in freed]
            for joint in joints:
                index = [self._add(joint, tangent[:, joint]) for tangent in of_point]
                told = {name: float(effect.sizes(name)[joint] * value) for name, value in point.items()}
                for variant in variants:
                    columns = tuple(index[freed.index(one)] for one in variant)
                    self._linear(family, effect, joint, None, told, variant, columns)

    def _grid_points(self, family: str, effect: Effect, points: Sequence[Mapping[str, float]]) -> None:
        reaches_others = effect.reaches_other_joints
        together = [range(self.n_joint)] if not reaches_others else [[joint] for joint in range(self.n_joint)]
        shared = self.u if isinstance(effect, VelocityEffect) else None
        for joints in together:
            hypotheses = [self._at(family, effect, point, joints) for point in points]
            velocities = self.simulation.velocities(hypotheses, shared)
            for point, velocity in zip(points, velocities, strict=True):
                change = self.residual - self._residual(velocity)
                for joint in joints:
                    told = {name: float(effect.sizes(name)[joint] * value) for name, value in point.items()}
                    column = self._add(joint, change[:, joint])
                    self._grid_point(family, joint, told, column, 1.0, BETWEEN_POINTS)
                    if family == DELAY and not self._without_timing:
                        for factor in FACTORS_OF_ONE_CHANNEL:
                            late = {name: factor * value for name, value in told.items()}
                            self._grid_point(TIMING, joint, late, column, factor, OF_ONE_CHANNEL)

    def _grid_point(
        self, family: str, joint: int, point: Mapping[str, float], column: int, mean: float, scale: float
    ) -> None:
        self.terms.append(Term(family, joint, None, point, (), (column,), (mean,), (scale,), (0.0,), (2.0,)))

    def dependence(self, family: str, effect: Dependence) -> None:
        """A family that is linear in all its parameters, per joint that it depends on."""
        joints = range(self.n_joint)
        for source in range(effect.n_source):
            freed = freed_of(effect, source)
            directions = [direction_of(family, effect, one, joints) for one in freed]
            tangents = list(self._tangents([NOMINAL] * len(directions), directions))
            for joint in joints:
                if effect.variable == "command" and source == joint:
                    continue
                index = tuple(self._add(joint, tangent[:, joint]) for tangent in tangents)
                named = source if effect.per_source else None
                self._linear(family, effect, joint, named, {}, freed, index)

    def _linear(
        self,
        family: str,
        effect: Effect,
        joint: int,
        source: int | None,
        point: Mapping[str, float],
        freed: Variant,
        columns: tuple[int, ...],
    ) -> None:
        lower, upper = bounds_of(effect, freed)
        scale = tuple((USUAL_SHARE * (upper - lower)).tolist())
        bounds = tuple(lower.tolist()), tuple(upper.tolist())
        self.terms.append(
            Term(family, joint, source, point, freed, columns, (0.0,) * len(columns), scale, *bounds)
        )

    def _at(
        self, family: str, effect: Effect, point: Mapping[str, float], joints: Sequence[int]
    ) -> Hypothesis:
        of = effect.neutral()
        for name, value in point.items():
            of[name][list(joints)] = effect.sizes(name)[list(joints)] * value
        return Hypothesis({family: of})
