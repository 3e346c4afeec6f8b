"""All parameters of all effects found, at once: Gauss-Newton on the velocities' squared residual.

Every joint is fitted by itself, but for those whose effects have a value in common. Derivatives are finite differences
of the compiled simulation; parameters of different joints are moved at the same time, as most effects on one joint
change the others' velocities by next to nothing.
"""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import (
    Coordinate,
    ParameterGroup,
    coordinates_of,
    difference_step,
    groups_of,
    value_of,
    with_common_values,
    with_value,
)
from pipeline.discrepancy.selection.known.prior import prior_rows
from pipeline.discrepancy.selection.regression import bounded_least_squares
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of, residual_of

ITERATIONS = 15
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e3  # of the curvature; what is too long even then leads nowhere
SETTLED = 1e-4  # of the squares: joints whose step takes off less have arrived
LINEAR_ROOM = 0.5  # of the range between a linear coefficient's bounds: its step is right wherever it starts


def refine(simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Gauss-Newton from where the search left off; a joint's step is kept only if its squares fall.

    Where they do not, the step was too long: the next is shorter. Each is the best within the bounds, so that a value
    that cannot move further does not keep the others where they are. What an earlier run found is a prior.
    Source: Levenberg-Marquardt as in Nocedal and Wright (2006), Numerical Optimization, chapter 10.
    """
    found = list(found)
    coordinates = coordinates_of(simulation, found)
    for coordinate in itertools.chain(*coordinates.values()):
        within = float(np.clip(value_of(found, coordinate), coordinate.lower, coordinate.upper))
        found = with_value(found, coordinate, within)
    groups = groups_of(simulation.effects, found, coordinates)
    found = with_common_values(found, groups)
    wrapped = [f.candidate.family for f in found if has_wrapper(f.candidate)]
    is_by_group = not any(simulation.effects[family].reaches_other_joints for family in wrapped)
    damping = dict.fromkeys(groups, FIRST_DAMPING)
    for _ in range(ITERATIONS):
        moving = {joint: coordinates[joint] for group in groups for joint in group.joints}
        if not moving:
            break
        residual, jacobian = residual_and_jacobian(simulation, rows, found, moving)
        trial = list(found)
        for group in groups:
            of_prior, distances, _ = prior_rows(found, group.columns)
            step = _step_within_bounds(
                found,
                group,
                np.vstack([group.stacked(jacobian, moving, rows), of_prior]),
                np.concatenate([group.of_its_joints(residual, rows), distances]),
                damping[group],
            )
            for column, change in zip(group.columns, step, strict=True):
                for coordinate in column:
                    trial = with_value(trial, coordinate, value_of(found, coordinate) + float(change))
        after = residual_of(simulation, rows, trial)
        arrived = set()
        for group in groups:
            squares_before, squares_after = (
                group.squares(left, rows) + float(np.sum(prior_rows(of, group.columns)[1] ** 2))
                for left, of in ((residual, found), (after, trial))
            )
            if squares_after <= squares_before:
                is_full_step = damping[group] <= 1.0
                damping[group] = max(0.3 * damping[group], 1e-6)
                has_arrived = is_full_step and squares_after >= squares_before * (1.0 - SETTLED)
            else:
                damping[group] *= 10.0
                has_arrived = damping[group] > LARGEST_DAMPING
                for index, effect in enumerate(found):
                    if effect.candidate.joint in group.joints:
                        trial[index] = effect
            if has_arrived:
                arrived.add(group)
        found = trial
        if is_by_group:  # else what is moved on another joint may call it on
            groups = [group for group in groups if group not in arrived]
        if arrived.issuperset(groups):
            break
    return found


def _step_within_bounds(
    found: Sequence[SelectedEffect],
    group: ParameterGroup,
    jacobian: np.ndarray,
    residual: np.ndarray,
    damping: float,
) -> np.ndarray:
    """(k,) damped Gauss-Newton step of a group's columns, by jacobian (M, k) and residual (M,)."""
    rooms = np.array([_room(column[0], value_of(found, column[0])) for column in group.columns])
    curvature = np.sum(jacobian**2, axis=0)
    damped = np.vstack([jacobian, np.diag(np.sqrt(damping * (curvature + 1e-12)))])
    wanted = np.concatenate([residual, np.zeros(len(group.columns))])
    return bounded_least_squares(damped, wanted, rooms[:, 0], rooms[:, 1])


def _room(coordinate: Coordinate, value: float) -> tuple[float, float]:
    """How far a value may be moved in one step, down and up."""
    limit = 0.5 * max(abs(value), 0.1 * coordinate.size)
    if coordinate.name is None:
        limit = max(limit, 0.5 * LINEAR_ROOM * (coordinate.upper - coordinate.lower))
    return min(max(coordinate.lower - value, -limit), 0.0), max(min(coordinate.upper - value, limit), 0.0)


def refine_alone(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect], candidate: Candidate
) -> Candidate:
    """Move one candidate off its grid, the effects that were found before held where they are."""
    return refined_together(simulation, rows, found, [candidate])[0] if candidate.point else candidate


def refined_together(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect], candidates: Sequence[Candidate]
) -> list[Candidate]:
    """Move candidates on different joints off their grids, beside the effects that were found before."""
    before = residual_of(simulation, rows, found)
    fitted = refine(simulation, rows, [*found, *map(SelectedEffect, candidates)])[len(found) :]
    after = residual_of(simulation, rows, [*found, *fitted])
    return [
        the_better(candidate, of.candidate, rows, before[:, candidate.joint], after[:, candidate.joint])
        for candidate, of in zip(candidates, fitted, strict=True)
    ]


def the_better(
    candidate: Candidate, refined: Candidate, rows: ScoredRows, before: np.ndarray, after: np.ndarray
) -> Candidate:
    """The refined one with what it explains of the rows it was fitted to; the one of the grid if that explains more.

    Args:
        candidate: The one of the grid.
        refined: The same, moved off it.
        rows: That it was fitted to.
        before: (N,) residual of its joint without it.
        after: (N,) the same with it.
    """
    floor = rows.floor[candidate.joint]
    by_block = np.bincount(rows.folds.block, before**2 - after**2, minlength=rows.folds.n_blocks) / floor
    gain = float(by_block.sum())
    if gain <= candidate.gain:
        return candidate
    share = gain * floor / max(float(np.sum(before**2)), 1e-12)
    return replace(refined, gain=gain, share=share, gain_by_block=by_block)


def completed(simulation: Simulation, candidate: Candidate, present: Collection[str] = ()) -> Candidate:
    """With the parameters that belong to an effect, but do not make it known.

    Args:
        simulation: On the measured logs.
        present: Families of effects that the nominal logs show themselves.
    """
    if not has_wrapper(candidate):
        return candidate
    effect = simulation.effects[candidate.family]
    of_family = effect.freed_later()
    if candidate.family in present:
        of_family += effect.freed_beside_nominal()
    later = tuple(one for one in of_family if one not in candidate.freed)
    coefficients = np.append(candidate.coefficients, np.zeros(len(later)))
    point = {**effect.fitted_later(), **candidate.point}
    return replace(candidate, point=point, freed=candidate.freed + later, coefficients=coefficients)


def gain_without(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect], left_out: SelectedEffect
) -> np.ndarray:
    """What an effect takes off the squares beside the others, per block, in units of the floor."""
    joint = left_out.candidate.joint
    others = [effect for effect in found if effect is not left_out]
    others = refine(simulation, rows, others)
    with_all = residual_of(simulation, rows, list(found))[:, joint]
    without = residual_of(simulation, rows, others)[:, joint]
    return (
        np.bincount(rows.folds.block, without**2 - with_all**2, minlength=rows.folds.n_blocks)
        / rows.floor[joint]
    )


def with_gains(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]
) -> list[SelectedEffect]:
    """Effects with what each takes off the squares beside the others."""
    after = residual_of(simulation, rows, found)
    result = []
    for effect in found:
        candidate = effect.candidate
        if not has_wrapper(candidate):
            result.append(effect)
            continue
        joint, floor = candidate.joint, rows.floor[candidate.joint]
        before = residual_of(simulation, rows, [of for of in found if of is not effect])[:, joint]
        taken = np.bincount(rows.folds.block, before**2 - after[:, joint] ** 2, minlength=rows.folds.n_blocks)
        share = float(taken.sum()) / max(float(np.sum(before**2)), 1e-12)
        of = replace(candidate, gain=float(taken.sum() / floor), share=share, gain_by_block=taken / floor)
        result.append(replace(effect, candidate=of))
    return result


def residual_and_jacobian(
    simulation: Simulation,
    rows: ScoredRows,
    found: list[SelectedEffect],
    coordinates: dict[int, list[Coordinate]],
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Residual (N, n_joint), and per joint the derivatives (N, k) of its velocity by its coordinates."""
    together = _moved_together(simulation, found, coordinates)
    hypotheses = [hypothesis_of(simulation, found)]
    for moves in together:
        moved = list(found)
        for coordinate in moves.values():
            moved = with_value(
                moved, coordinate, value_of(found, coordinate) + difference_step(found, coordinate)
            )
        hypotheses.append(hypothesis_of(simulation, moved))
    velocities = [rows.weight * rows.averaged(v) for v in simulation.velocities(hypotheses)]
    residual = rows.weight * rows.averaged(simulation.sequences.velocity) - velocities[0]
    columns: dict[Coordinate, np.ndarray] = {}
    for moves, velocity in zip(together, velocities[1:], strict=True):
        for joint, coordinate in moves.items():
            columns[coordinate] = (velocity - velocities[0])[:, joint] / difference_step(found, coordinate)
    jacobian = {
        joint: np.stack([columns[coordinate] for coordinate in of_joint], axis=1)
        for joint, of_joint in coordinates.items()
        if of_joint
    }
    return residual, jacobian


def _moved_together(
    simulation: Simulation, found: Sequence[SelectedEffect], coordinates: Mapping[int, Sequence[Coordinate]]
) -> list[dict[int, Coordinate]]:
    """Coordinates by joint that are moved at the same time; by themselves, where other joints would feel it."""
    alone, queues = [], []
    for joint, of_joint in coordinates.items():
        queue = []
        for coordinate in of_joint:
            effect = simulation.effects[found[coordinate.effect].candidate.family]
            if effect.reaches_other_joints:
                alone.append({joint: coordinate})
            else:
                queue.append((joint, coordinate))
        queues.append(queue)
    return alone + [
        dict(place for place in places if place is not None) for places in itertools.zip_longest(*queues)
    ]


def parameter_covariance(
    simulation: Simulation, rows: ScoredRows, found: list[SelectedEffect]
) -> dict[int, tuple[list[Coordinate], np.ndarray]]:
    """Per joint the coordinates and their covariance, robust against any correlation within blocks, priors included.

    Source: Liang and Zeger (1986), Longitudinal data analysis using generalized linear models (sandwich estimator).
    """
    coordinates = coordinates_of(simulation, found)
    if not any(coordinates.values()):
        return {}
    residual, jacobian = residual_and_jacobian(simulation, rows, found, coordinates)
    result = {}
    for group in groups_of(simulation.effects, found, coordinates):
        a, r = group.stacked(jacobian, coordinates, rows), group.of_its_joints(residual, rows)
        block = np.tile(rows.folds.block, len(group.joints))  # what joints have in common in a block stays so
        scores = np.stack(
            [np.bincount(block, column * r, minlength=rows.folds.n_blocks) for column in a.T], axis=1
        )
        of_prior, _, correlated = prior_rows(found, group.columns)
        bread = np.linalg.pinv(a.T @ a + of_prior.T @ of_prior + 1e-12 * np.eye(a.shape[1]))
        covariance = bread @ (scores.T @ scores + (of_prior.T * correlated) @ of_prior) @ bread
        for joint in group.joints:
            result[joint] = (coordinates[joint], group.of_joint(covariance, coordinates[joint]))
    return result
