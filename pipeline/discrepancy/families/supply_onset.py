"""A `supply_variation` that sets in at some moment: before it joints have no change of speed in common.

No wrapper says what it does next, and an estimate of it does little harm where there is nothing to estimate
(`onset.py` looks for harm): what tells is that it explains nothing for so long as chance does not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import gammainc

from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED, ScoredRows, averaged
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.supply_variation import (
    SHORTEST_S,
    course_of_the_supply,
    gains_of_the_supply,
)
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.onset import AS_GOOD, SMALLEST_PART, rows_since

LARGEST_P = 1e-3  # of so little for so long by chance, at any of the moments that are tried
FEWEST_VALUES = 1e-3  # for their distribution to be one
LEAST_SHARE = 0.1  # of what it explains later, per motion, that is told from nothing


def supply_onset(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, members: Sequence[Candidate]
) -> tuple[int, tuple[int, int]] | None:
    """When a common change of speed set in, and between which moments rows do not tell; None: it was always there.

    The squares of an Ornstein-Uhlenbeck process have one independent value per correlation time; so many of them
    have a mean as small as before the moment by chance with the probability of a chi-square distribution.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows in use.
        members: It, on each joint that shows it.
    """
    widths_s = _widths_s(members)
    gain, motion, time_s = course_of_the_supply(simulation, active, rows, widths_s)
    first = simulation.sequences.stamp_ns.min()
    stamps = averaged(simulation.sequences.stamp_ns - first, rows.is_used)
    order = np.argsort(stamps, kind="stable")
    gained, moved = (np.concatenate([[0.0], np.cumsum(of[order])]) for of in (gain, motion))
    share = moved / max(moved[-1], 1e-12)
    inside = np.flatnonzero((share > SMALLEST_PART) & (share < 1.0 - SMALLEST_PART))
    if not len(inside):
        return None
    total = gained[-1] - gained
    place = int(inside[np.argmax(total[inside])])
    later = total[place] / max(moved[-1] - moved[place], 1e-12)
    earlier = gained[place] / max(moved[place], 1e-12)
    # A moving average, too, has few independent squares; nothing is told while joints do not move together.
    apart_s = max(time_s, np.sqrt(2.0 * np.pi) * max(widths_s.values()), SHORTEST_S)
    told_s = (
        ROWS_AVERAGED
        * simulation.setting.dt_s
        * np.sum((motion > LEAST_SHARE * motion.mean())[order[:place]])
    )
    n_values = max(float(told_s / apart_s), FEWEST_VALUES)
    if later <= 0.0 or _so_little_by_chance(earlier / later, n_values) > LARGEST_P:
        return None
    as_good = inside[total[inside] > total[place] - AS_GOOD]
    moments = stamps[order[[max(as_good[0] - 1, 0), as_good[-1]]]]
    begin, end = (int(first + moment) for moment in moments)
    return (begin + end) // 2, (begin, end)


def _widths_s(members: Sequence[Candidate]) -> dict[int, float]:
    return {c.joint: float(c.point["width"]) for c in members}


def _so_little_by_chance(share: float, n_values: float) -> float:
    """How probable it is that the mean square of independent normal values is no larger than this share of its own."""
    return float(gammainc(0.5 * n_values, 0.5 * n_values * max(share, LEAST_SHARE)))


def supply_since(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    moment: tuple[int, tuple[int, int]],
    members: Sequence[Candidate],
) -> list[Candidate]:
    """The members from a moment on: as they are, but for what they gain before it; arguments as of `supply_onset`.

    Not fitted anew: the others' common change is the same estimate, and next to nothing before.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows in use.
        moment: Of `supply_onset`.
        members: It, on each joint.
    """
    onset, between = moment
    _, is_after = rows_since(simulation, rows, onset)
    block, n_blocks = rows.folds.block, rows.folds.n_blocks
    since = []
    gains = gains_of_the_supply(simulation, active, rows, _widths_s(members))
    for member in members:
        gain = is_after * gains[member.joint]
        since.append(
            replace(
                member,
                onset=onset,
                onset_between=between,
                gain=float(gain.sum()),
                gain_by_block=np.bincount(block, gain, minlength=n_blocks),
                share=member.share * float(gain.sum()) / member.gain if member.gain else 0.0,
                owed=member.owed * float(is_after.mean()),
            )
        )
    return since
