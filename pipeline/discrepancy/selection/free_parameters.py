"""Values of effects that can be moved: parameters on a grid, and coefficients that the velocity is linear in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.effect import Effect

RELATIVE_STEP = 0.04
SMALLEST_STEP = 0.004


@dataclass(frozen=True)
class Coordinate:
    """One value that can be moved: a parameter on the grid (`name`) or a coefficient (`index`) of one effect.

    Steps and bounds of lengths are in proportion to `size`: see `Effect.sizes`.
    """

    effect: int
    name: str | None
    index: int
    lower: float
    upper: float
    size: float = 1.0


def coordinates_of(simulation: Simulation, found: Sequence[SelectedEffect]) -> dict[int, list[Coordinate]]:
    """Per joint, what can be moved of the effects found on it."""
    result: dict[int, list[Coordinate]] = {}
    for number, one in enumerate(found):
        candidate = one.candidate
        of_joint = result.setdefault(candidate.joint, [])
        if not has_wrapper(candidate) or candidate.deviation is not None:
            continue
        effect = simulation.effects[candidate.family]
        by_name = {p.name: p for p in effect.card.parameters}
        for name in candidate.point:
            size = float(effect.sizes(name)[candidate.joint])
            lower, upper = size * by_name[name].lower, size * by_name[name].upper
            of_joint.append(Coordinate(number, name, 0, lower, upper, size))
        for index, freed in enumerate(candidate.freed):
            parameter = by_name.get(freed[0][0])
            lower = parameter.lower - parameter.neutral if parameter else -2.0
            upper = parameter.upper - parameter.neutral if parameter else 2.0
            of_joint.append(Coordinate(number, None, index, lower, upper))
    return result


def value_of(found: Sequence[SelectedEffect], coordinate: Coordinate) -> float:
    """Of the parameter or the coefficient."""
    candidate = found[coordinate.effect].candidate
    return float(
        candidate.point[coordinate.name] if coordinate.name else candidate.coefficients[coordinate.index]
    )


def with_value(found: list[SelectedEffect], coordinate: Coordinate, value: float) -> list[SelectedEffect]:
    """The effects, one of them with another value."""
    candidate = found[coordinate.effect].candidate
    if coordinate.name:
        changed = replace(candidate, point={**candidate.point, coordinate.name: value})
    else:
        coefficients = np.array(candidate.coefficients)
        coefficients[coordinate.index] = value
        changed = replace(candidate, coefficients=coefficients)
    result = list(found)
    result[coordinate.effect] = replace(found[coordinate.effect], candidate=changed)
    return result


def difference_step(found: Sequence[SelectedEffect], coordinate: Coordinate) -> float:
    """By how much a value is moved for a finite difference."""
    value = value_of(found, coordinate)
    step = max(RELATIVE_STEP * abs(value), SMALLEST_STEP * coordinate.size)
    return -step if value + step > coordinate.upper else step


Column = tuple[Coordinate, ...]
"""What is moved as one: a value of one joint's effect, or one of the machine, which several joints' effects have."""


@dataclass(frozen=True)
class ParameterGroup:
    """Joints that are fitted together, as their effects have values in common; mostly one joint by itself.

    Attributes:
        joints: Indices.
        columns: What can be moved.
    """

    joints: tuple[int, ...]
    columns: tuple[Column, ...]

    def stacked(
        self,
        jacobian: Mapping[int, np.ndarray],
        coordinates: Mapping[int, Sequence[Coordinate]],
        rows: ScoredRows,
    ) -> np.ndarray:
        """(n_joint_of_group * N, k) derivatives by the columns, joint after joint, in units of the noise floor.

        Args:
            jacobian: Per joint (N, n), by its coordinates.
            coordinates: Per joint, in that order.
        """
        n = len(rows.weight)
        result = np.zeros((len(self.joints) * n, len(self.columns)))
        for place, joint in enumerate(self.joints):
            for index, column in enumerate(self.columns):
                for coordinate in column:
                    if coordinate in coordinates[joint]:
                        of_joint = jacobian[joint][:, coordinates[joint].index(coordinate)]
                        result[place * n : (place + 1) * n, index] += of_joint / np.sqrt(rows.floor[joint])
        return result

    def of_joint(self, matrix: np.ndarray, coordinates: Sequence[Coordinate]) -> np.ndarray:
        """The part (n, n) of a matrix (k, k) over the columns that a joint's coordinates have."""
        places = [next(i for i, column in enumerate(self.columns) if of in column) for of in coordinates]
        return matrix[np.ix_(places, places)]

    def of_its_joints(self, residual: np.ndarray, rows: ScoredRows) -> np.ndarray:
        """(N, n_joint) to (n_joint_of_group * N,), in the same order and units."""
        joints = list(self.joints)
        return (residual[:, joints] / np.sqrt(rows.floor[joints])).T.ravel()

    def squares(self, residual: np.ndarray, rows: ScoredRows) -> float:
        """Of a residual (N, n_joint) on its joints, in units of the noise floor."""
        return float(np.sum(self.of_its_joints(residual, rows) ** 2))


def groups_of(
    effects: Mapping[str, Effect],
    found: Sequence[SelectedEffect],
    coordinates: Mapping[int, Sequence[Coordinate]],
) -> list[ParameterGroup]:
    """Every joint that has something to move, with those that it shares a value with."""
    in_common: dict[tuple[str, str], list[Coordinate]] = {}
    alone: list[Column] = []
    for coordinate in (of for of_joint in coordinates.values() for of in of_joint):
        family = found[coordinate.effect].candidate.family
        if coordinate.name is not None and coordinate.name in effects[family].of_the_machine:
            in_common.setdefault((family, coordinate.name), []).append(coordinate)
        else:
            alone.append((coordinate,))
    columns = [*map(tuple, in_common.values()), *alone]
    groups: list[tuple[set[int], list[Column]]] = []
    for column in columns:
        joints = {found[coordinate.effect].candidate.joint for coordinate in column}
        touching = [group for group in groups if group[0] & joints]
        groups = [group for group in groups if not group[0] & joints]
        merged = joints.union(*(of for of, _ in touching))
        groups.append((merged, [*(c for _, of in touching for c in of), column]))
    return [ParameterGroup(tuple(sorted(joints)), tuple(of)) for joints, of in groups]


def with_common_values(found: list[SelectedEffect], groups: Sequence[ParameterGroup]) -> list[SelectedEffect]:
    """The effects, with one value of what they have in common: the mean, by what each explains."""
    for column in (column for group in groups for column in group.columns if len(column) > 1):
        gains = [max(found[coordinate.effect].candidate.gain, 1e-9) for coordinate in column]
        mean = float(np.average([value_of(found, coordinate) for coordinate in column], weights=gains))
        for coordinate in column:
            found = with_value(found, coordinate, mean)
    return found
