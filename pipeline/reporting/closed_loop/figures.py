"""Figures of a closed loop's report: residuals per joint and along the logs, signatures, errors."""

import math
from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.verdict.report_data import LevelErrors, ReportData, ResidualTrack, Signature
from pipeline.reporting.closed_loop.bars import Bar, bar_panel
from pipeline.reporting.closed_loop.chart import WIDE, Panel, span
from pipeline.reporting.closed_loop.quantities import readable_unit
from pipeline.reporting.closed_loop.words import short_family_name
from pipeline.reporting.figures.style import REGION, SERIES

AFTER, BEFORE, FINETUNED, WRONG, _, BLACKBOX = SERIES
# Pale, as lines are drawn over them.
PURPOSE_COLOURS = {
    Purpose.fit: ("#eef1f4", "used to fit"),
    Purpose.select: ("#e3eefb", "used to choose"),
    Purpose.confirm: ("#fdebd3", "held out, looked at once"),
}
BASELINES = {
    "finetune": ("fine-tuned network", FINETUNED),
    "blackbox_residual": ("black-box residual", BLACKBOX),
    "wrong_effect": ("wrong effect", WRONG),
}
COUNTED = {"axis": "", "motion": ", along the motion", "change": ", along the change"}  # by names of `Along`
TRACK_POINTS = 200  # a panel is some 260 px wide
Z_95 = 1.96  # 97.5 % quantile of the standard normal distribution


def residual_bars(evidence: ReportData, corrected: bool) -> list[str]:
    """Bars per joint: residual velocity before and, if corrected, after; on nominal logs also as a dashed line."""
    panels = []
    for j, (joint, unit) in enumerate(zip(evidence.joints, evidence.units, strict=True)):
        factor, name = readable_unit(f"{unit}/s")
        floor = factor * float(evidence.floor[j])
        bars = [Bar("before" if corrected else "measured logs", factor * float(evidence.before[j]), BEFORE)]
        if corrected:
            bars.append(Bar("after", factor * float(evidence.after[j]), AFTER))
        panels.append(bar_panel(joint, name, [*bars, Bar("nominal logs", floor, REGION)], floor))
    return panels


def track_rows(evidence: ReportData, most: int, corrected: bool) -> list[tuple[str, list[str]]]:
    """Name and one panel per joint of at most `most` logs: residual velocity over time, on equal scales."""
    tops = []
    for j in range(len(evidence.joints)):
        shown = [values[:, j] for track in evidence.tracks for values in (track.before, track.after)]
        tops.append(max(span([*shown, float(evidence.floor[j]), 0.0])[1], 1e-9))
    return [
        (track.trajectory, [_track_panel(evidence, track, j, top, corrected) for j, top in enumerate(tops)])
        for track in evidence.tracks[:most]
    ]


def _track_panel(evidence: ReportData, track: ResidualTrack, j: int, top: float, corrected: bool) -> str:
    factor, unit = readable_unit(f"{evidence.units[j]}/s")
    t_s = np.asarray(track.t_s, float)
    edges = _edges(t_s)
    panel = Panel(
        evidence.joints[j],
        (edges[0], edges[-1]),
        (0.0, factor * top),
        "time since the log's start [s]",
        unit,
        150,
    )
    purpose = np.asarray(track.purpose)
    starts = np.flatnonzero(np.diff(purpose, prepend=-1)) if len(purpose) else np.zeros(0, int)
    for begin, end in zip(starts, [*starts[1:], len(purpose)], strict=True):
        kind = Purpose(int(purpose[begin]))
        if kind in PURPOSE_COLOURS:
            panel.band(edges[begin], edges[end], PURPOSE_COLOURS[kind][0])
    panel.level(factor * float(evidence.floor[j]))
    lines = [(track.before, BEFORE, 1.4), (track.after, AFTER, 1.6)]
    for values, colour, width in lines if corrected else lines[:1]:
        times, thinned = _thinned(t_s, np.asarray(values, float)[:, j])
        panel.line(times, factor * thinned, colour, width=width)
    return panel.svg()


def signature_panels(evidence: ReportData) -> list[str]:
    """Panel per effect and joint: mean residual velocity over the variable that the effect depends on.

    Effects without a correction have no fitted line.
    """
    panels = []
    for signature in evidence.signatures:
        factor, unit = readable_unit(signature.unit)
        x = np.asarray(signature.x, float)
        before, error, fitted, after = (
            factor * np.asarray(values, float)
            for values in (signature.before, signature.standard_error, signature.fitted, signature.after)
        )
        reach = Z_95 * np.nan_to_num(error)
        panel = Panel(
            f"{short_family_name(signature.family)} ({signature.joint})",
            span([x], 0.04),
            span([before - reach, before + reach, fitted, after, 0.0]),
            signature.variable,
            f"{unit}{COUNTED[signature.along]}",
            210,
            WIDE,
        )
        panel.level(0.0)
        if corrects(signature):
            panel.line(x, fitted, AFTER, width=2.0)
        panel.dots(x, before, BEFORE, half_widths=Z_95 * error)
        if corrects(signature):
            panel.dots(x, after, AFTER, hollow=True)
        panels.append(panel.svg())
    return panels


def corrects(signature: Signature) -> bool:
    """Whether the effect changes the model's prediction; an unpredictable effect does not."""
    return bool(np.any(signature.fitted))


def error_bars(evidence: ReportData, level: LevelErrors, corrected: bool) -> list[str]:
    """Bars per joint: errors before, after correction, and of the baselines; on nominal logs as a dashed line."""
    panels = []
    for j, (joint, unit) in enumerate(zip(evidence.joints, evidence.units, strict=True)):
        factor, name = readable_unit(unit)
        rows = [("before" if corrected else "model", level.before, BEFORE, level.before_interval)]
        if corrected:
            rows.append(("corrected model", level.after, AFTER, level.after_interval))
        bars = [
            Bar(label, factor * float(values[j]), colour, _interval(factor, bounds, j))
            for label, values, colour, bounds in rows
        ]
        for key, (label, colour) in BASELINES.items():
            if key in level.baselines:
                bars.append(Bar(label, factor * float(level.baselines[key][j]), colour))
        panels.append(bar_panel(joint, name, bars, factor * float(level.nominal_floor[j]), WIDE))
    return panels


def _interval(factor: float, bounds: np.ndarray, j: int) -> tuple[float, float] | None:
    low, high = (factor * float(bound) for bound in np.asarray(bounds)[:, j])
    return (low, high) if math.isfinite(low) and math.isfinite(high) else None


def _edges(middles: np.ndarray) -> np.ndarray:
    """Edges of blocks from their centres, shape (n + 1,)."""
    if len(middles) == 0:
        return np.array([0.0, 1.0])
    half = float(np.median(np.diff(middles))) / 2 if len(middles) > 1 else 0.5
    return np.concatenate([[middles[0] - half], (middles[1:] + middles[:-1]) / 2, [middles[-1] + half]])


def _thinned(t_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root mean squares of neighbouring samples, which bound the page's size."""
    stride = max(1, -(-len(values) // TRACK_POINTS))
    if stride == 1:
        return t_s, values
    groups: Sequence[np.ndarray] = np.split(values, range(stride, len(values), stride))
    means = np.array([np.sqrt(np.mean(group**2)) for group in groups])
    return np.array([float(np.mean(t)) for t in np.split(t_s, range(stride, len(t_s), stride))]), means
