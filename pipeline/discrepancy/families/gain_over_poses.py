"""A joint's speed that has changed wherever the joint stands, by more here and by less there: still a gain.

The same worn valve takes more of a loaded joint's speed than of one that hangs, and what a joint carries depends on its
pose. A dependence on the joint's own place follows that and explains more than a gain, though nothing begins at any
place. What does depend on the place is a change that is not there somewhere.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import GAIN
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, velocity_of

ON_POSITION = "other:position"
MOVING_SHARE = 0.3  # of the usual speed
NEARLY_ALL = 0.95  # of the rows in which the joint moves one way
LEAST_SHARE = 0.5  # of the change in the middle of all rows, on nearly all


def is_a_gain_over_poses(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    dependence: Candidate,
    name: Candidate,
) -> bool:
    """Whether a dependence is on the own place of a joint whose name is a gain, and is nowhere without it.

    Args:
        simulation: Of the measured logs.
        rows: In use.
        found: What both are beside.
        dependence: Any.
        name: Any.
    """
    joint = name.joint
    is_own_place = dependence.family == ON_POSITION and dependence.source == joint == dependence.joint
    if name.family != GAIN or not is_own_place:
        return False
    without, having = (
        velocity_of(simulation, of)[..., joint] for of in (found, [*found, SelectedEffect(dependence)])
    )
    smallest = MOVING_SHARE * simulation.setting.speed_scale[joint]
    told = [way for one in name.freed for way, _ in one]
    ways = {"ratio_positive": 1.0, "ratio_negative": -1.0}
    return all(
        _is_everywhere(having[moves] / without[moves] - 1.0)
        for moves in (rows.is_used & (ways[way] * without > smallest) for way in told)
    )


def _is_everywhere(change: np.ndarray) -> bool:
    """Whether nearly all rows have a good part of the median change."""
    if not change.size:
        return False
    usual = float(np.median(change))
    return float(np.quantile(change * np.sign(usual), 1.0 - NEARLY_ALL)) >= LEAST_SHARE * abs(usual) > 0.0
