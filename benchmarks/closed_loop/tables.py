"""The score as Markdown tables."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.closed_loop.comparison import Outcome, true_label
from benchmarks.closed_loop.goals import FALSE_ALARMS, Figure, figures, roc
from benchmarks.closed_loop.simulators import KINDS, SIMULATORS

DASH = "–"


def goals_table(outcomes: Sequence[Outcome], only_visible: bool) -> str:
    """One line per figure, one column per simulator: value, number counted, interval; bold where a goal is missed."""
    columns = by_simulator(outcomes)
    of = [{f.name: f for f in figures(scored, only_visible)} for scored in columns.values()]
    names = list(dict.fromkeys(name for column in of for name in column))
    goals = {name: figure.goal for column in of for name, figure in column.items()}
    rows = [
        (name, goals[name], *(_cell(column[name]) if name in column else DASH for column in of))
        for name in names
    ]
    return table(("figure", "goal", *columns), rows)


def roc_table(outcomes: Sequence[Outcome], only_visible: bool) -> str:
    """Detection at shares of false alarms, and the area below the curve, one line per simulator."""
    rows = []
    for name, scored in by_simulator(outcomes).items():
        shares, area = roc(scored, only_visible)
        rows.append((name, *(_written(share, True) for share in shares), _written(area, False)))
    return table(("simulator", *(f"at {100 * share:g} %" for share in FALSE_ALARMS), "area"), rows)


def lost_table(outcomes: Sequence[Outcome]) -> str:
    """By which step effects were lost, above and below the visible size, one column per simulator."""
    columns = by_simulator(outcomes)
    counts = {
        name: Counter(
            (step, effect.is_visible)
            for o in scored
            for effect, step in zip(o.truth.effects, o.lost, strict=True)
            if step is not None
        )
        for name, scored in columns.items()
    }
    steps = sorted({step for count in counts.values() for step, _ in count})
    rows = [
        (step, *(f"{count[step, True]} + {count[step, False]}" for count in counts.values()))
        for step in steps
    ]
    return table(("lost (visible + too small)", *columns), rows)


def by_simulator(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Outcomes by the simulator that their cases come from, as far as there are any."""
    parts = {name: [o for o in outcomes if o.truth.simulator == name] for name in SIMULATORS}
    return {name: scored for name, scored in parts.items() if scored}


def case_table(outcomes: Sequence[Outcome]) -> str:
    """One line per case."""
    heads = (
        *(
            "case",
            "simulator, number",
            "kind",
            "times visible",
            "style",
            "truth",
            "verdict",
            "named",
            "right",
        ),
        *("lost", "parameter error", "covered", "exam before → after, 1e-3", "s"),
    )
    return table(heads, (_case_row(o) for o in sorted(outcomes, key=_order)))


def family_table(outcomes: Sequence[Outcome]) -> str:
    """One line per kind of case."""
    heads = (
        *(
            "kind",
            "n",
            "detected",
            "right first",
            "equivalent",
            "wrong names",
            "joints F1",
            "parameter error",
        ),
        *("covered", "reduction", "median s"),
    )
    rows = []
    for kind in KINDS:
        of_kind = [o for o in outcomes if o.truth.kind == kind]
        if of_kind:
            rows.append(_family_row(kind, of_kind))
    return table(heads, rows)


def confusion_table(outcomes: Sequence[Outcome]) -> str:
    """How often each kind (rows) had what named first (columns); `?` where the verdict was ambiguous."""
    counts = Counter((o.truth.kind, _short(o)) for o in outcomes)
    columns = sorted({column for _, column in counts})
    rows = [
        (kind, *(str(counts[kind, column] or "") for column in columns))
        for kind in KINDS
        if any(key[0] == kind for key in counts)
    ]
    return table(("truth", *columns), rows)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _order(outcome: Outcome) -> tuple[str, int, int]:
    return outcome.truth.simulator, KINDS.index(outcome.truth.kind), outcome.truth.number


def _case_row(o: Outcome) -> tuple[str, ...]:
    relative = [p.relative for p in o.parameters if p.relative is not None]
    covered = f"{sum(p.covered for p in o.parameters)}/{len(o.parameters)}" if o.parameters else DASH
    times = [e.size / e.visible_size for e in o.truth.effects if e.visible_size is not None]
    return (
        o.case,
        f"{o.truth.simulator} {o.truth.number}",
        o.truth.kind,
        ", ".join(f"{value:.1f}" for value in times) or DASH,
        o.truth.style,
        _truth(o),
        o.verdict,
        ", ".join(o.named) or DASH,
        _right(o),
        ", ".join(step for step in o.lost if step is not None) or DASH,
        f"{100 * float(np.median(relative)):.1f} %" if relative else DASH,
        covered,
        _exam(o),
        f"{o.seconds:.0f}",
    )


def _family_row(kind: str, outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    n, hits = len(outcomes), [hit for o in outcomes for hit in o.hits]
    true, false, missed = np.sum([o.joints for o in outcomes], axis=0)
    parameters = [p for o in outcomes for p in o.parameters]
    return (
        kind,
        str(n),
        f"{sum(o.detected is True for o in outcomes)}/{n}",
        f"{sum(hits)}/{len(hits)}",
        str(sum(o.half_hits for o in outcomes)),
        str(sum(o.wrong_name for o in outcomes)),
        f"{2 * true / (2 * true + false + missed):.2f}" if true + false + missed else DASH,
        _percent([p.relative for p in parameters]),
        f"{sum(p.covered for p in parameters)}/{len(parameters)}" if parameters else DASH,
        _percent([o.reduction for o in outcomes]),
        f"{np.median([o.seconds for o in outcomes]):.0f}",
    )


def _truth(o: Outcome) -> str:
    return (
        " + ".join(
            f"{true_label(effect)}{f' ({effect.kind})' if effect.family == 'other' else ''} {','.join(effect.joints)}"
            for effect in o.truth.effects
        )
        or "none"
    )


def _right(o: Outcome) -> str:
    if not o.truth.effects:
        return "**false alarm**" if o.detected is True else "yes"
    if o.wrong_name:
        return "**wrong name**"
    if o.dependence is not None and not any(o.hits):
        return f"other, {o.dependence}"
    if all(o.hits):
        return "yes"
    return f"{sum(o.hits)} of {len(o.hits)}" + (f", {o.half_hits} equivalent" if o.half_hits else "")


def _short(o: Outcome) -> str:
    name = o.first.partition(" of ")[0]
    return f"{name}?" if o.verdict == "ambiguous" else name


def _exam(o: Outcome) -> str:
    if o.before is None or o.after is None:
        return DASH
    return f"{1e3 * o.before:.1f} → {1e3 * o.after:.1f}"


def _percent(values: Iterable[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{100 * float(np.median(known)):.1f} %" if known else DASH


def _cell(figure: Figure) -> str:
    if figure.value is None:
        return DASH
    text = f"{_written(figure.value, figure.is_share)} of {figure.n}"
    if figure.met is False:
        text = f"**{text}**"
    if figure.interval is None:
        return text
    return f"{text} ({' to '.join(_written(value, figure.is_share) for value in figure.interval)})"


def _written(value: float, is_share: bool) -> str:
    if not math.isfinite(value):
        return DASH if math.isnan(value) else "∞"
    return f"{100 * value:.1f} %" if is_share else f"{value:.3g}"
