"""The figures of the goals: what counts, over which cases, against which goal."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.binomial import clopper_pearson, median_interval
from benchmarks.closed_loop.comparison import AMBIGUOUS, OTHER, Outcome
from benchmarks.closed_loop.dependence import Dependence
from benchmarks.closed_loop.sessions import MACHINE
from benchmarks.closed_loop.simulators import OUTSIDE
from pipeline.configuration.load import load_machine

REACHED = 0.95  # of 1.3: a case counts as of the stated size from here on
LEAST_RATIO, LEAST_HALF_RATIO = 1.3, 1.15
TIME_LIMIT_S = 180.0
LEAST_F1 = 0.97


@dataclass(frozen=True)
class Figure:
    """One line of the goals' table.

    Attributes:
        name: What is measured.
        goal: In words; empty for what stands there for information.
        value: None where there are no cases.
        n: Number of what was counted.
        interval: Exact 95 % interval; None where there is none.
        met: Whether the measured value meets the goal; None without goal or cases.
        is_share: Whether the value is to be written in percent.
    """

    name: str
    goal: str
    value: float | None
    n: int
    interval: tuple[float, float] | None
    met: bool | None
    is_share: bool = True


Test = Callable[[float], bool]


def figures(outcomes: Sequence[Outcome], left_out: Sequence[Outcome]) -> list[Figure]:
    """All lines of the goals' table.

    Args:
        outcomes: Of the cases with the whole catalogue.
        left_out: Of the cases whose true card was deleted.
    """
    null = [o for o in outcomes if o.truth.kind == kinds.NULL]
    half = [o for o in outcomes if o.truth.kind == kinds.HALF]
    full = [o for o in outcomes if o.truth.kind not in (kinds.NULL, kinds.HALF)]
    outside = [o for o in full if o.truth.kind in OUTSIDE]
    n_joint = len(load_machine(MACHINE).joint_names)
    on_some = [o for o in full if sum(o.joints[::2]) < n_joint]
    return [
        _share("detection", "≥ 98 %", [o.detected is True for o in full], lambda x: x >= 0.98),
        _share("false alarms", "≤ 5 %", [o.detected is True for o in null], lambda x: x <= 0.05),
        *_families(full),
        _share(
            "wrong family named with certainty", "≤ 2 %", [o.wrong_name for o in full], lambda x: x <= 0.02
        ),
        _f1("right joints (F1)", "≥ 0.97", full),
        _f1("– of effects on some of the joints", "", on_some),
        *_parameters(full),
        *_errors(full),
        _share(
            "outside the catalogue: `other`, right `depends_on`",
            "≥ 90 %",
            [o.dependence == Dependence.right and o.first == OTHER for o in outside],
            lambda x: x >= 0.9,
        ),
        _share("– of these near misses", "", [o.dependence == Dependence.near for o in outside]),
        _share(
            "true card deleted: `other` or abstention",
            "≥ 85 %",
            [abstained(o) for o in left_out],
            lambda x: x >= 0.85,
        ),
        _share("– of these `none`", "", [o.verdict == "none" for o in left_out]),
        _share("– of these ambiguous", "", [o.verdict == AMBIGUOUS for o in left_out]),
        _share(
            "true card deleted: wrong name", "≤ 5 %", [o.wrong_name for o in left_out], lambda x: x <= 0.05
        ),
        _share("half size: detection", "≥ 80 %", [o.detected is True for o in half], lambda x: x >= 0.8),
        _share("half size: wrong name", "≤ 5 %", [o.wrong_name for o in half], lambda x: x <= 0.05),
        *_times(outcomes),
    ]


def of_stated_size(outcome: Outcome) -> bool:
    """Whether all effects of a case reach the stated error ratio (nulls do)."""
    least = LEAST_HALF_RATIO if outcome.truth.kind == kinds.HALF else LEAST_RATIO
    return all(effect.ratio is None or effect.ratio >= REACHED * least for effect in outcome.truth.effects)


def abstained(outcome: Outcome) -> bool:
    """Whether no catalogue family was named: `other`, several equivalent ones, none, or unexcited."""
    if outcome.verdict == "named":
        return outcome.first == OTHER
    return outcome.verdict in ("outside_catalogue", AMBIGUOUS, "unexcited", "none")


def _families(full: Sequence[Outcome]) -> list[Figure]:
    n = sum(len(o.truth.effects) for o in full)
    hits, half = sum(o.hits for o in full), sum(o.half_hits for o in full)
    right = [True] * hits + [False] * (n - hits)
    among = [True] * half + [False] * (n - half)
    return [
        _share("right family named first (pairs count twice)", "≥ 95 %", right, lambda x: x >= 0.95),
        _share("– beside these: among equivalent ones", "", among),
    ]


def _f1(name: str, goal: str, scored: Sequence[Outcome]) -> Figure:
    true, false, missed = np.sum([o.joints for o in scored], axis=0) if scored else (0, 0, 0)
    value = float(2 * true / (2 * true + false + missed)) if true + false + missed else None
    met = value >= LEAST_F1 if goal and value is not None else None
    return Figure(name, goal, value, len(scored), None, met, is_share=False)


def _parameters(full: Sequence[Outcome]) -> list[Figure]:
    found = [p for o in full for p in o.parameters]
    relative = [p.relative for p in found if p.relative is not None]
    of_change = [p.of_change for p in found if p.of_change is not None]
    signs = [sign for o in full for sign in o.signs]
    onsets = [o.onset_error_s for o in full if o.onset_error_s is not None]
    return [
        _median("parameters: median relative error", "≤ 6 %", relative, lambda x: x <= 0.06),
        _median(
            "– with those of effects not found as infinite",
            "",
            [*relative, *[math.inf] * sum(o.n_not_told for o in full)],
        ),
        _median("– relative to the change from neutral", "", of_change),
        _share(
            "parameters: 95 % intervals that cover",
            "90-98 %",
            [p.covered for p in found],
            lambda x: 0.9 <= x <= 0.98,
        ),
        _share("– direction or side right", "", signs),
        _median("– onset: median error, s", "", onsets, is_share=False),
    ]


def _errors(full: Sequence[Outcome]) -> list[Figure]:
    reductions = [o.reduction for o in full if o.reduction is not None]
    avoided = [o.avoided for o in full if o.avoided is not None]
    blackbox, finetune = (
        [o.beats[name] for o in full if o.truth.effects] for name in ("blackbox_residual", "finetune")
    )
    return [
        _median("exam error of affected joints: median reduction", "≥ 40 %", reductions, lambda x: x >= 0.4),
        _median("share of avoidable squared error: median", "≥ 80 %", avoided, lambda x: x >= 0.8),
        _share("lower held-out error than the black-box residual", "≥ 80 %", blackbox, lambda x: x >= 0.8),
        _share("– than fine-tuning", "", finetune),
    ]


def _times(outcomes: Sequence[Outcome]) -> list[Figure]:
    seconds = [o.seconds for o in outcomes]
    longest = max(seconds, default=None)
    met = longest <= TIME_LIMIT_S if longest is not None else None
    return [
        _median("run time: median, s", "", seconds, is_share=False),
        Figure("run time: longest, s", "≤ 180", longest, len(seconds), None, met, is_share=False),
    ]


def _share(name: str, goal: str, hits: Sequence[bool], test: Test | None = None) -> Figure:
    n = len(hits)
    value = sum(hits) / n if n else None
    met = test(value) if test is not None and value is not None else None
    return Figure(name, goal, value, n, clopper_pearson(sum(hits), n) if n else None, met)


def _median(
    name: str, goal: str, values: Iterable[float], test: Test | None = None, is_share: bool = True
) -> Figure:
    ordered = list(values)
    value = float(np.median(ordered)) if ordered else None
    interval = median_interval(ordered) if ordered else None
    if interval is not None and not all(map(math.isfinite, interval)):
        interval = None
    met = test(value) if test is not None and value is not None else None
    return Figure(name, goal, value, len(ordered), interval, met, is_share)
