"""Oil that stays cold makes joints late as much as slow: one cause, where each joint by itself has a sluggish valve."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.late_channel import late_channel
from pipeline.discrepancy.families.plausibility import DELAY, GAIN, LAG, STICTION, THERMAL_DRIFT, is_plausible
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import DOUBT_FACTOR, Comparison
from pipeline.discrepancy.selection.refine import completed, refine, refined_together, the_better
from pipeline.discrepancy.selection.regression import t_statistic
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of
from pipeline.effects.effect import Variant
from pipeline.effects.thermal_drift import EQUALLY_LATE

LATE_ALIKE = (LAG, STICTION)  # delays of all joints are a late channel
FIRST_LAG_S = FIRST_DELAY_S = 0.1
BOTH_WAYS: Variant = ((("ratio_positive", None), ("ratio_negative", None)),)
CONSTANT: dict[str, tuple[Mapping[str, float], Variant]] = {
    LAG: ({"added_time_constant": FIRST_LAG_S, "fall_share": EQUALLY_LATE}, ()),
    GAIN: ({}, BOTH_WAYS),
}
WARMING_T = 1.5  # of what oil explains beyond causes that do not change
FEWEST_JOINTS = 3  # valves of two may be sluggish
# What oil has to explain of what the same joints' own causes do: that every valve became sluggish is less likely
# than that oil is cold, a late channel is not.
OF_OWN_CAUSES = {LAG: 0.85, DELAY: 1.0}


def cold_oil(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    candidates: Sequence[Candidate],
    comparison: Comparison,
    excited: Collection[int],
) -> list[SelectedEffect]:
    """Cold oil on all joints that move enough, with how late it makes them, where all are as late by themselves.

    The screen knows it by its speeds alone, and so as less than it is.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: Effects beside it.
        candidates: Of the screen.
        comparison: Of candidates.
        excited: Joints that move enough to tell.

    Returns:
        One per joint, the clearest first, lags among their equivalents unless it explains clearly more than these;
        empty where it is not the oil.
    """
    joints = {c.joint for c in candidates if c.family == LAG and comparison.shows(c)}
    oil = [c for c in candidates if c.family == THERMAL_DRIFT and c.joint in joints]
    if len(oil) < FEWEST_JOINTS or not {c.joint for c in oil}.issuperset(excited):
        return []
    oil = refined_together(simulation, rows, found, [completed(simulation, c) for c in oil])
    if not is_plausible(THERMAL_DRIFT, oil):
        return []
    explained = sum(map(comparison.net, oil))
    equivalents: list[Candidate] = []
    for family, share in OF_OWN_CAUSES.items():
        of_family = [c for c in candidates if c.family == family and c.joint in joints]
        own = refined_together(simulation, rows, found, of_family)
        otherwise = sum(map(comparison.net, own))
        if explained < share * otherwise:
            return []
        more = np.sum([c.gain_by_block for c in oil], axis=0) - np.sum([c.gain_by_block for c in own], axis=0)
        if explained < DOUBT_FACTOR * otherwise and t_statistic(more) < comparison.config.equivalent_t:
            equivalents += own
    return [
        SelectedEffect(c, [e for e in equivalents if e.joint == c.joint])
        for c in sorted(oil, key=comparison.net, reverse=True)
    ]


def channel_beside(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    passes: Callable[[Candidate], bool],
    excited: Collection[int],
) -> list[Candidate]:
    """Delays of all joints, which stay as long as they are while the oil that was found warms up: a late channel.

    The screen does not see it. What makes joints late for good is told by then as a lag of the oil that hardly ends;
    only where both are fitted at once does the oil give it back.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: Effects beside it.
        passes: Whether a candidate removes enough beside what was found.
        excited: Joints that move enough to tell.

    Returns:
        One per joint that moves enough; empty where no oil was found, or where the channel is not late beside it.
    """
    oily = {f.candidate.joint for f in found if f.candidate.family == THERMAL_DRIFT}
    if not oily.issuperset(excited) or any(f.candidate.family == DELAY for f in found):
        return []
    first = [_constant(DELAY, {"added_delay": FIRST_DELAY_S}, (), joint) for joint in sorted(excited)]
    fitted = refine(simulation, rows, [*found, *map(SelectedEffect, first)])
    before, after = (residual_of(simulation, rows, of) for of in (found, fitted))
    delays = [
        the_better(delay, of.candidate, rows, before[:, delay.joint], after[:, delay.joint])
        for delay, of in zip(first, fitted[len(found) :], strict=True)
    ]
    return late_channel(delays, excited) if all(map(passes, delays)) else []


def hardly_warms(simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]) -> bool:
    """Whether lags and gains of the same joints, which stay as they are, explain as much as the oil that was found.

    Oil is told from them by its warming up: of a log much shorter than that takes, its equation fits whatever makes
    joints late alike.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: All effects.
    """
    joints = sorted({f.candidate.joint for f in found if f.candidate.family == THERMAL_DRIFT})
    if not joints:
        return False
    others = [f for f in found if f.candidate.family != THERMAL_DRIFT]
    had = {f.candidate.key for f in others}
    tried = [family for family in CONSTANT if family in simulation.effects]
    constant = [_constant(family, *CONSTANT[family], joint) for family in tried for joint in joints]
    instead = refine(simulation, rows, [*others, *(SelectedEffect(c) for c in constant if c.key not in had)])
    squares = [
        np.sum(residual_of(simulation, rows, of)[:, joints] ** 2 / rows.floor[joints], axis=1)
        for of in (instead, found)
    ]
    more = np.bincount(rows.folds.block, squares[0] - squares[1], minlength=rows.folds.n_blocks)
    return t_statistic(more) < WARMING_T


def _constant(family: str, point: Mapping[str, float], freed: Variant, joint: int) -> Candidate:
    """A cause that stays as it is, from which a fit can begin."""
    nothing = np.zeros(len(freed))
    return Candidate(
        family, joint, None, dict(point), freed, nothing, gain=0.0, share=0.0, gain_by_block=np.zeros(1)
    )


def with_doubts_of_the_oil(
    found: Sequence[SelectedEffect], screened: Sequence[Candidate]
) -> list[SelectedEffect]:
    """Joints that respond late one like the other need no cause each: oil that stays cold does that to several.

    Args:
        found: All effects that passed the gate.
        screened: Candidates of the first screen.
    """
    if any(f.candidate.family == THERMAL_DRIFT for f in found):
        return list(found)
    count = Counter(f.candidate.family for f in found if f.candidate.family in LATE_ALIKE)
    doubted = []
    for effect in found:
        if count[effect.candidate.family] > 1:
            joint, known = effect.candidate.joint, {c.family for c in effect.equivalents}
            cold = [c for c in screened if c.family == THERMAL_DRIFT and c.joint == joint and c.gain > 0.0]
            if THERMAL_DRIFT not in known:
                effect = replace(effect, equivalents=[*effect.equivalents, *cold])
        doubted.append(effect)
    return doubted
