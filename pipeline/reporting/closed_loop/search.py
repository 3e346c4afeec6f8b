"""The search of a closed loop: ranking of hypotheses, alternatives, and selected effects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.discrepancy.verdict.report_data import RankedEffect, ReportData
from pipeline.reporting.closed_loop.quantities import MISSING, estimate, number, percent
from pipeline.reporting.closed_loop.verdict import certainty_in_words, effect_label, equivalents
from pipeline.reporting.closed_loop.words import (
    Document,
    dependences,
    family_name,
    listed,
    parameter_name,
)

N_OPEN, N_LISTED = 10, 60  # hypotheses that are open at first, and in all
WIDEST_PX = 90  # width of the longest bar
FOUND = "found"  # outcome of a selected hypothesis


@dataclass(frozen=True)
class RankingLine:
    """One displayed hypothesis; `width` is that of its bar, px."""

    place: int
    name: str
    share: str
    null_share: str
    outcome: str
    found: bool
    width: int


@dataclass(frozen=True)
class EffectCard:
    """One effect: its parameters (name, key, value, interval, unit) and further facts (name, value)."""

    name: str
    parameters: list[tuple[str, str, str, str, str]]
    facts: list[tuple[str, str]]


def ranking(evidence: ReportData) -> list[list[RankingLine]]:
    """Hypotheses by decreasing share: those open at first, then those folded."""
    known = [line.share for line in evidence.ranking if math.isfinite(line.share)]
    largest = max([share for share in known if share > 0], default=1.0)
    lines = [
        RankingLine(
            place + 1,
            hypothesis_name(one),
            percent(one.share),
            percent(one.null_share),
            one.outcome,
            one.outcome == FOUND,
            round(WIDEST_PX * max(0.0, one.share) / largest) if math.isfinite(one.share) else 0,
        )
        for place, one in enumerate(evidence.ranking[:N_LISTED])
    ]
    return [part for part in (lines[:N_OPEN], lines[N_OPEN:]) if part]


def hypothesis_name(one: RankedEffect) -> str:
    """`shared oil flow (arm, through boom)`."""
    source = f", through {one.source}" if one.source else ""
    return f"{family_name(one.family)} ({listed(one.joints)}{source})"


def ranking_answer(document: Document, evidence: ReportData) -> str:
    """A sentence on how clear the decision was."""
    tried = len(evidence.ranking)
    twins = equivalents(document)
    effects = document.get("effects") or []
    if twins:
        names = " and ".join(effect_label(one) for one in [effects[0], *twins])
        return f"These logs cannot tell apart: {names}."
    if not tried:
        return "The search left no list of hypotheses."
    if not effects:
        return f"None of {tried} hypotheses passed the checks."
    found = [one for one in evidence.ranking if one.outcome == FOUND]
    losers = [one for one in evidence.ranking if one.outcome != FOUND]
    if not found or not losers:
        return f"{tried} hypotheses were tried."
    best, loser = found[0], losers[0]
    return (
        f"Of {tried} hypotheses the best alone, {hypothesis_name(best)}, removes {percent(best.share)} of the squared "
        f"residual; the best of those that lost, {hypothesis_name(loser)}, removes {percent(loser.share)}."
    )


def alternatives(document: Document) -> list[tuple[str, str, str, str]]:
    """Name, probability, removed error and reason for rejection of each fully fitted alternative."""
    rows = []
    for one in document.get("alternatives") or []:
        reason = str(one.get("why_not") or MISSING)
        if one.get("equivalent"):
            reason = "Cannot be told apart by these logs." + (f" {reason}" if reason != MISSING else "")
        likely, removed = (percent(number(one.get(key))) for key in ("probability", "error_reduction"))
        rows.append((effect_label(one), likely, removed, reason))
    return rows


def effect_cards(document: Document) -> list[EffectCard]:
    """Cards of the selected effects: parameters with intervals and units, and further facts."""
    return [
        EffectCard(effect_label(effect), _parameters(effect), _facts(effect))
        for effect in document.get("effects") or []
    ]


def _parameters(effect: Document) -> list[tuple[str, str, str, str, str]]:
    rows = []
    for name, parameter in (effect.get("parameters") or {}).items():
        if isinstance(parameter, Mapping) and "value" in parameter:
            value, interval, unit = _shown(parameter)
            rows.append(
                (
                    parameter_name(name),
                    name,
                    value,
                    f"{interval[0]} to {interval[1]}" if interval else MISSING,
                    unit,
                )
            )
        else:
            text = ", ".join(map(str, parameter)) if isinstance(parameter, list) else str(parameter)
            rows.append((parameter_name(name), name, text, MISSING, ""))
    return rows


def _shown(parameter: Mapping[str, Any]) -> tuple[str, tuple[str, str] | None, str]:
    if isinstance(parameter["value"], int | float):
        return estimate(parameter)
    return str(parameter["value"]), None, str(parameter.get("unit", ""))


def _facts(effect: Document) -> list[tuple[str, str]]:
    facts = [
        ("Depends on", dependences(effect)),
        ("Certainty", certainty_in_words(effect)),
        ("Probability of this name, if anything has changed", percent(number(effect.get("probability")))),
        (
            "Error removed by it alone",
            f"{percent(number(effect.get('error_reduction')))} of the squared error",
        ),
    ]
    onset = effect.get("onset")
    if onset:
        facts.append(("Sets in", f"{number(onset['t']):.0f} s after the start of {onset['trajectory']}"))
    facts.append(("Name in closed_loop.json", str(effect["family"])))
    return facts
