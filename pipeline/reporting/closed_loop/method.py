"""Text around the figures of a closed loop's report: headline figures and provenance."""

import math

import numpy as np

from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.reporting.closed_loop.quantities import (
    number,
    percent,
    probability,
    readable_unit,
    significant,
    with_unit,
)
from pipeline.reporting.closed_loop.verdict import (
    VERDICT_WORDS,
    affected_joints,
    held_out_error,
    is_corrected,
)
from pipeline.reporting.closed_loop.words import Document, listed

ABOVE_FLOOR = 1.1  # times the noise floor; smaller excess is not reported


def key_figures(document: Document, evidence: ReportData) -> list[tuple[str, str]]:
    """Value and label of the headline figures."""
    verdict = str(document["verdict"])
    word = VERDICT_WORDS.get(verdict, verdict)
    several = verdict == "named" and len(document["effects"]) > 1
    corrected = is_corrected(document)
    shown = [("effects named" if several else word, "verdict")]
    for joint in affected_joints(document)[:2]:
        unit = evidence.units[evidence.joints.index(joint)]
        factor, _ = readable_unit(unit)
        before, after = (factor * held_out_error(document, when, joint) for when in ("before", "after"))
        if math.isfinite(before) and math.isfinite(after):
            both = [significant(before, 2), significant(after, 2)] if corrected else [significant(before, 2)]
            text = with_unit(" → ".join(both), unit)
            shown.append((text, f"4 s error of the {joint}, held-out logs"))
    effects = document.get("effects") or []
    if corrected and math.isfinite(number(effects[0].get("error_reduction"))):
        share = percent(number(effects[0]["error_reduction"]))
        shown.append((share, "of the squared error removed by the first effect alone"))
    if effects and math.isfinite(number(effects[0].get("p_value"))):
        shown.append(
            (probability(number(effects[0]["p_value"])), "probability of such a pattern without any effect")
        )
    ratios = _multiples_of_floor(evidence.before, evidence)
    if not effects and np.isfinite(ratios).any():
        worst = int(np.nanargmax(ratios))
        shown.append(
            (
                f"{significant(ratios[worst], 2)} ×",
                f"the noise floor: the largest residual ({evidence.joints[worst]})",
            )
        )
    steps = (document.get("held_out") or {}).get("n_steps")
    if not effects and steps:
        shown.append((str(steps), "held-out steps that errors are from"))
    return shown


def residual_answer(evidence: ReportData, corrected: bool) -> str:
    """Unexplained residual per joint in multiples of the noise floor, before and after."""
    before, after = (
        _multiples_of_floor(evidence.before, evidence),
        _multiples_of_floor(evidence.after, evidence),
    )
    known = [j for j in range(len(evidence.joints)) if math.isfinite(before[j])]
    above = sorted((j for j in known if before[j] > ABOVE_FLOOR), key=lambda j: -before[j])
    if not known:
        return "There is no noise floor to compare with."
    if not above:
        return "No joint leaves more unexplained than the model's own noise floor."
    parts = []
    for j in above:
        change = f" ({significant(after[j], 2)} times after)" if corrected and math.isfinite(after[j]) else ""
        parts.append(f"{significant(before[j], 2)} times in the {evidence.joints[j]}{change}")
    return f"The model leaves more unexplained than its noise floor: {listed(parts)}."


def memory_sentence(evidence: ReportData) -> str:
    """Correlation time of the residual per joint; empty if unknown."""
    parts = [
        f"{joint} {significant(float(time_s), 2)} s"
        for joint, time_s in zip(evidence.joints, evidence.autocorrelation_s, strict=True)
        if math.isfinite(time_s)
    ]
    if not parts:
        return ""
    return (
        f"The measured residual is correlated in time: {listed(parts)}. Rows closer than that are not independent "
        "evidence; all intervals here take that into account."
    )


def provenance(document: Document, machine_name: str, nominal: str, measured: str) -> list[tuple[str, str]]:
    """Provenance of the figures as names and values."""
    held_out = document.get("held_out") or {}
    return [
        ("Machine", machine_name),
        ("Nominal logs", nominal),
        ("Measured logs", measured),
        ("Held-out rule", str(held_out.get("rule", "–"))),
        ("Held-out steps", str(held_out.get("n_steps", "–"))),
        ("Error", "root mean square of predicted minus measured position; 4 s: windows of 80 steps of 50 ms"),
    ]


def _multiples_of_floor(residual: np.ndarray, evidence: ReportData) -> np.ndarray:
    """Multiples of the noise floor, shape (n_joint,); NaN without a noise floor."""
    floor = np.where(np.asarray(evidence.floor) > 0, evidence.floor, np.nan)
    return np.asarray(residual, float) / floor
