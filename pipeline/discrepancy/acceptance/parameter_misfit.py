"""How far the diagnosis model's own misfit moves a parameter, seen on nominal logs where no effect is.

An interval from the residual's scatter alone holds only if nothing but the effect changed between two recordings. It
did: oil, operator and places differ from session to session, and the diagnosis model generalises so well and no better.
The same parameters are therefore fitted, one Gauss-Newton step from the effects found, to the residuals of nominal
parts that the members did not see; what comes out, and should be zero, is added to their covariance.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.selection.free_parameters import coordinates_of, groups_of
from pipeline.discrepancy.selection.refine import residual_and_jacobian
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

MISFIT_PARTS = 6  # of the nominal logs: four minutes each, of 24


def without_onsets(found: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Effects as nominal logs would show them, which know no onset."""
    return [replace(f, candidate=replace(f.candidate, onset=None)) for f in found]


def nominal_parts(n_rows: int) -> np.ndarray:
    """(N,) the part that each nominal row is of."""
    return np.arange(n_rows) * MISFIT_PARTS // max(n_rows, 1)


def misfit_covariance(
    simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]
) -> dict[int, np.ndarray]:
    """Mean square of the parameters that parts of the nominal logs ask for, per joint, (k, k).

    Args:
        simulation: On nominal logs, by members that did not see them.
        rows: Of the nominal logs.
        found: Effects, in the order of their coordinates.
    """
    residual = residual_of(simulation, rows, [])
    everywhere, part = without_onsets(found), nominal_parts(len(residual))
    coordinates = coordinates_of(simulation, everywhere)
    if not any(coordinates.values()):
        return {}
    _, jacobian = residual_and_jacobian(simulation, rows, everywhere, coordinates)
    result = {}
    for group in groups_of(simulation.effects, everywhere, coordinates):
        a, r = group.stacked(jacobian, coordinates, rows), group.of_its_joints(residual, rows)
        part_of_row = np.tile(part, len(group.joints))
        # Curvature of all rows, not of the part: a part that hardly shows the effect says little, not anything.
        bread = np.linalg.pinv(a.T @ a + 1e-12 * np.eye(a.shape[1])) * MISFIT_PARTS
        in_part = [part_of_row == number for number in range(MISFIT_PARTS)]
        asked = np.stack([bread @ (a[rows_of].T @ r[rows_of]) for rows_of in in_part])
        for joint in group.joints:
            result[joint] = group.of_joint(asked.T @ asked / MISFIT_PARTS, coordinates[joint])
    return result
