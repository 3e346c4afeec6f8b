"""Held-out errors before and after correction beside the baselines, and sentences on which is best."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.verdict.report_data import LevelErrors, ReportData
from pipeline.reporting.closed_loop.figures import BASELINES
from pipeline.reporting.closed_loop.quantities import STEP_S, number, readable_unit, significant, with_unit
from pipeline.reporting.closed_loop.verdict import HORIZON, affected_joints, held_out_error, is_corrected
from pipeline.reporting.closed_loop.words import Document, joints_in_words, listed

HEADINGS = {"before": "before", "after": "corrected model"} | {
    name: label for name, (label, _) in BASELINES.items()
}
TIE = 1.005  # errors closer than that are equally good


@dataclass(frozen=True)
class ErrorCell:
    """A formatted error, its 95 % interval, and whether it is the smallest of its row."""

    text: str
    interval: str = ""
    best: bool = False


@dataclass(frozen=True)
class ErrorRow:
    """One level of prediction and one joint."""

    level: str
    joint: str
    unit: str
    affected: bool
    cells: Sequence[ErrorCell]
    floor: str


def levels_of(document: Document, evidence: ReportData) -> list[LevelErrors]:
    """Levels with test windows; the four-second level comes from the document if the report data lack it."""
    levels = [level for level in evidence.levels if level.n_windows > 0]
    if any(level.steps == 80 for level in levels) or not document.get("error"):
        return levels
    unknown = np.full((2, len(evidence.joints)), math.nan)
    baselines = document.get("baselines") or {}

    def column(of: Document) -> np.ndarray:
        return np.array([number((of.get(HORIZON) or {}).get(joint)) for joint in evidence.joints])

    before, after = (
        np.array([held_out_error(document, when, joint) for joint in evidence.joints])
        for when in ("before", "after")
    )
    known = {name: column(baselines[name]) for name in BASELINES if name in baselines}
    floor = column(baselines.get("nominal_floor") or {})
    levels.append(LevelErrors(80, before, after, unknown, unknown, known, floor, 1))
    return sorted(levels, key=lambda level: level.steps)


def level_name(steps: int) -> str:
    """`80 steps (4 s)`."""
    return f"{steps} {'step' if steps == 1 else 'steps'} ({steps * STEP_S:g} s)"


def columns_of(document: Document, evidence: ReportData) -> dict[str, str]:
    """Heading by column; `after` only if a correction was made."""
    levels = levels_of(document, evidence)
    known = {
        name for level in levels for name, values in level.baselines.items() if np.isfinite(values).any()
    }
    known |= {"before", "after"} if is_corrected(document) else {"before"}
    return {name: heading for name, heading in HEADINGS.items() if name in known}


def error_rows(document: Document, evidence: ReportData) -> list[ErrorRow]:
    """The table, level by level and joint by joint; cells in the order of `columns_of`."""
    affected, columns = affected_joints(document), columns_of(document, evidence)
    rows = []
    for level in levels_of(document, evidence):
        for j, joint in enumerate(evidence.joints):
            factor, unit = readable_unit(evidence.units[j])
            values = {name: _error(level, name, j) for name in columns}
            best = min((value for value in values.values() if math.isfinite(value)), default=math.nan)
            cells = []
            for name, value in values.items():
                low, high = (factor * bound for bound in _interval(level, name, j))
                interval = f"{significant(low)} to {significant(high)}" if math.isfinite(low + high) else ""
                cells.append(ErrorCell(significant(factor * value), interval, value <= TIE * best))
            floor = significant(factor * float(level.nominal_floor[j]))
            rows.append(ErrorRow(level_name(level.steps), joint, unit, joint in affected, cells, floor))
    return rows


def winner_sentences(document: Document, evidence: ReportData) -> list[str]:
    """Which predictor is best on the affected joints, or on all joints without an effect.

    One sentence for every level and joint at which another predictor beats the corrected model. Without a correction,
    only predictors that beat the model beyond its uncertainty are named.
    """
    own = "after" if is_corrected(document) else "before"
    joints = affected_joints(document) or evidence.joints
    columns = list(columns_of(document, evidence))
    lost, won = [], []
    for level in levels_of(document, evidence):
        if not all(math.isfinite(_error(level, own, evidence.joints.index(joint))) for joint in joints):
            continue
        sentences = [_loss(level, joint, evidence, own, columns) for joint in joints]
        lost += [sentence for sentence in sentences if sentence]
        if not any(sentences):
            won.append(level_name(level.steps))
    if own == "after" and won and len(columns) > 1:
        how = "best of all" if columns[2:] else "better than the model before"
        return [
            f"The corrected model predicts {joints_in_words(joints)} {how} at {listed(won)}.",
            *lost,
        ]
    return lost


def _loss(level: LevelErrors, joint: str, evidence: ReportData, own: str, columns: Sequence[str]) -> str:
    j = evidence.joints.index(joint)
    values = {name: _error(level, name, j) for name in columns}
    values = {name: value for name, value in values.items() if math.isfinite(value)}
    best = min(values, key=lambda name: values[name])
    low, _ = _interval(level, own, j)
    within = math.isfinite(low) and values[best] >= low
    if values[own] <= TIE * values[best] or (own == "before" and within):
        return ""
    factor, _ = readable_unit(evidence.units[j])
    numbers = f"{significant(factor * values[best])} against {significant(factor * values[own])}"
    who = "uncorrected model" if best == "before" else HEADINGS[best]
    return (
        f"At {level_name(level.steps)} the {who} predicts the {joint} better than the "
        f"{'corrected model' if own == 'after' else 'model'} does: {with_unit(numbers, evidence.units[j])}"
        f"{', which is within the uncertainty' if within else ''}."
    )


def missing_levels(evidence: ReportData) -> list[str]:
    """Levels that could not be judged, in words."""
    return [
        f"No held-out stretch is long enough to judge {level_name(level.steps)}."
        for level in evidence.levels
        if level.n_windows == 0
    ]


def _error(level: LevelErrors, name: str, j: int) -> float:
    values = {"before": level.before, "after": level.after}.get(name, level.baselines.get(name))
    return math.nan if values is None else float(values[j])


def _interval(level: LevelErrors, name: str, j: int) -> tuple[float, float]:
    bounds = {"before": level.before_interval, "after": level.after_interval}.get(name)
    return (math.nan, math.nan) if bounds is None else (float(bounds[0][j]), float(bounds[1][j]))
