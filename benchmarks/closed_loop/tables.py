"""The score as Markdown tables."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.closed_loop.comparison import Outcome, true_label
from benchmarks.closed_loop.goals import Figure
from benchmarks.closed_loop.simulators import KINDS

N_WORST = 12
DASH = "–"


def goals_table(everything: Sequence[Figure], stated: Sequence[Figure]) -> str:
    """Figure, goal, measured, n and interval over all cases, and measured over those of the stated sizes."""
    rows = [
        (
            figure.name,
            figure.goal,
            _value(figure),
            {True: "yes", False: "**no**", None: ""}[figure.met],
            str(figure.n),
            _interval(figure),
            f"{_value(sized)} ({sized.n})",
        )
        for figure, sized in zip(everything, stated, strict=True)
    ]
    return table(
        ("figure", "goal", "measured", "met", "n", "exact 95 % interval", "sizes as stated (n)"), rows
    )


def case_table(outcomes: Sequence[Outcome]) -> str:
    """One line per case."""
    heads = (
        *(
            "case",
            "kind",
            "ratio",
            "simulator",
            "variant, style",
            "truth",
            "verdict",
            "named",
            "joints",
            "right",
        ),
        *("parameter error", "covered", "exam before → after, mrad", "vs black box", "s"),
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
        *("covered", "reduction", "avoided", "beats black box", "median s"),
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


def worst_table(outcomes: Sequence[Outcome]) -> str:
    """The worst cases first: wrong names and false alarms, then misses, then other families, then large errors."""
    worst = sorted(outcomes, key=_badness, reverse=True)[:N_WORST]
    return case_table_in_order([o for o in worst if _badness(o) > (0.0, 0.0)])


def case_table_in_order(outcomes: Sequence[Outcome]) -> str:
    """Worst cases with their trouble."""
    rows = [
        (o.case, o.truth.kind, str(o.truth.seed), _truth(o), o.verdict, ", ".join(o.named) or DASH, _exam(o))
        for o in outcomes
    ]
    return table(("case", "kind", "seed", "truth", "verdict", "named", "exam before → after, mrad"), rows)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _order(outcome: Outcome) -> tuple[int, str, int]:
    return KINDS.index(outcome.truth.kind), outcome.truth.simulator, outcome.truth.seed


def _badness(o: Outcome) -> tuple[float, float]:
    trouble = 0.0
    if o.truth.effects:
        trouble = 3.0 * o.wrong_name + 2.0 * (o.detected is not True) + (o.hits < len(o.truth.effects))
    elif o.detected is True:
        trouble = 3.0
    return trouble, max(-(o.reduction or 0.0), 0.0)


def _case_row(o: Outcome) -> tuple[str, ...]:
    relative = [p.relative for p in o.parameters if p.relative is not None]
    covered = f"{sum(p.covered for p in o.parameters)}/{len(o.parameters)}" if o.parameters else DASH
    return (
        o.case,
        f"{o.truth.kind} {o.truth.seed}",
        ", ".join(f"{effect.ratio:.2f}" for effect in o.truth.effects if effect.ratio is not None) or DASH,
        o.truth.simulator,
        f"{o.truth.variant}, {o.truth.style}",
        _truth(o),
        o.verdict,
        ", ".join(o.named) or DASH,
        "/".join(map(str, o.joints)) if o.truth.effects else DASH,
        _right(o),
        f"{100 * float(np.median(relative)):.1f} %" if relative else DASH,
        covered,
        _exam(o),
        {True: "lower", False: "higher", None: DASH}[o.beats.get("blackbox_residual")],
        f"{o.seconds:.0f}",
    )


def _family_row(kind: str, outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    n, n_effect = len(outcomes), sum(len(o.truth.effects) for o in outcomes)
    true, false, missed = np.sum([o.joints for o in outcomes], axis=0)
    parameters = [p for o in outcomes for p in o.parameters]
    beats = [o.beats["blackbox_residual"] for o in outcomes if "blackbox_residual" in o.beats]
    return (
        kind,
        str(n),
        f"{sum(o.detected is True for o in outcomes)}/{n}",
        f"{sum(o.hits for o in outcomes)}/{n_effect}",
        str(sum(o.half_hits for o in outcomes)),
        str(sum(o.wrong_name for o in outcomes)),
        f"{2 * true / (2 * true + false + missed):.2f}" if true + false + missed else DASH,
        _percent([p.relative for p in parameters]),
        f"{sum(p.covered for p in parameters)}/{len(parameters)}" if parameters else DASH,
        _percent([o.reduction for o in outcomes]),
        _percent([o.avoided for o in outcomes]),
        f"{sum(beats)}/{len(beats)}" if beats else DASH,
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
    if o.dependence is not None and not o.hits:
        return f"other, {o.dependence}"
    if o.hits == len(o.truth.effects):
        return "yes"
    return f"{o.hits} of {len(o.truth.effects)}" + (f", {o.half_hits} equivalent" if o.half_hits else "")


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


def _value(figure: Figure) -> str:
    return DASH if figure.value is None else _written(figure.value, figure.is_share)


def _interval(figure: Figure) -> str:
    if figure.interval is None:
        return DASH
    return " … ".join(_written(value, figure.is_share) for value in figure.interval)


def _written(value: float, is_share: bool) -> str:
    if not math.isfinite(value):
        return "∞"
    return f"{100 * value:.1f} %" if is_share else f"{value:.3g}"
